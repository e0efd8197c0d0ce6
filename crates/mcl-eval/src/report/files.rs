//! Tables and charts of result folders that have no rows, from the files beside them.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_core::text::of_cell;
use mcl_study::study::definition::Study;
use mcl_study::study::views::{Axis, Chart, ChartKind, Scale};
use mcl_study::table::{Row, Table, Value};
use mcl_study::view::chart::{ChartData, Panel, PanelAxis, Point};
use mcl_study::view::labels::axis_label;

/// Size limit of a table of a result folder (bytes).
const MAX_BYTES: u64 = 64 << 20;

/// A table saved as CSV; `None` where there is no file.
///
/// # Errors
/// When it cannot be read, or is not a table.
pub fn read_table(path: &Path) -> Result<Option<Table>> {
    let cannot = || format!("cannot read {}", path.display());
    let metadata = match fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error).with_context(cannot),
    };
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        bail!("{}: expected a file of at most {MAX_BYTES} bytes", path.display());
    }
    parse_table(&fs::read(path).with_context(cannot)?).with_context(cannot).map(Some)
}

fn parse_table(bytes: &[u8]) -> Result<Table> {
    let mut reader = csv::Reader::from_reader(bytes);
    let mut table = Table::new(reader.headers()?.iter());
    for record in reader.records() {
        table.push(record?.iter().map(value).collect());
    }
    Ok(table)
}

/// A cell as [`Table::to_csv`] wrote it.
fn value(cell: &str) -> Value {
    let is_number = cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
    match cell {
        "" => Value::Empty,
        "true" | "false" => (cell == "true").into(),
        _ => match (cell.parse(), cell.parse()) {
            (Ok(count), _) if is_number => Value::Count(count),
            (_, Ok(number)) if is_number && f64::is_finite(number) => Value::Number(number),
            _ => of_cell(cell).into(),
        },
    }
}

/// A chart from the table of its points, laid out as in the study, where that is known.
pub fn chart(name: &str, points: &Table, study: Option<&Study>) -> ChartData {
    let view = study.and_then(|study| study.views.charts.iter().find(|view| is_of(view, name)));
    let mut panels: Vec<Panel> = Vec::new();
    for row in points.rows() {
        let (title, measure) = (row.text("panel"), row.text("measure"));
        let is_it = |panel: &Panel| panel.title == title && panel.y.label == measure;
        let place = panels.iter().position(is_it).unwrap_or_else(|| {
            panels.push(panel(title, measure, view));
            panels.len() - 1
        });
        let found = point(&row, &mut panels[place]);
        panels[place].points.extend(found);
    }
    panels.retain(|panel| !panel.points.is_empty());
    ChartData {
        name: name.to_owned(),
        kind: view.map_or(ChartKind::Curves, |view| view.kind),
        panels,
        columns: view.and_then(|view| view.columns).unwrap_or(1),
        caption: view
            .map(|view| view.caption.clone())
            .into_iter()
            .filter(|c| !c.is_empty())
            .collect(),
    }
}

/// Whether a figure belongs to a chart: its name may have a part per value of a column.
pub fn is_of(view: &Chart, name: &str) -> bool {
    match view.name.split_once('{') {
        None => view.name == name,
        Some((start, rest)) => {
            let end = rest.rsplit_once('}').map_or("", |(_, end)| end);
            name.len() > start.len() + end.len() && name.starts_with(start) && name.ends_with(end)
        }
    }
}

fn panel(title: &str, measure: &str, view: Option<&Chart>) -> Panel {
    let is_part = |title_of: &str| !title_of.is_empty() && title.starts_with(title_of);
    let parts = view.map_or(&[][..], |view| &view.parts);
    let number = parts.iter().position(|part| is_part(&part.title)).unwrap_or(0);
    let part = parts.get(number);
    let axis = |label: String, own: Option<Scale>, axis: Option<&Axis>| PanelAxis {
        label,
        scale: own.or(axis.map(|axis| axis.scale)).unwrap_or_default(),
        places: Vec::new(),
    };
    let x = view.and_then(|view| view.x.as_ref());
    let label = x.map(|x| x.label.clone().unwrap_or_else(|| axis_label(&x.column[0])));
    Panel {
        title: title.to_owned(),
        part: number,
        x: axis(label.unwrap_or_else(|| "x".to_owned()), part.and_then(|part| part.x), x),
        y: axis(measure.to_owned(), part.and_then(|part| part.y), view.map(|view| &view.y)),
        curves: String::new(),
        labels: Vec::new(),
        points: Vec::new(),
    }
}

/// A row of the table as a point of a panel; its label and position are added if they are new.
fn point(row: &Row<'_>, panel: &mut Panel) -> Option<Point> {
    let place_of = |names: &mut Vec<String>, name: &str| {
        names.iter().position(|known| known == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        })
    };
    let y = row.number("y")?;
    let x = match row.get("x") {
        Value::Empty => return None,
        x if panel.x.scale == Scale::Places || x.number().is_none() => {
            panel.x.scale = Scale::Places;
            place_of(&mut panel.x.places, &x.to_string()) as f64 + 1.0
        }
        x => x.number()?,
    };
    let mark = Some(row.get("mark").to_string()).filter(|mark| !mark.is_empty());
    Some(Point {
        curve: place_of(&mut panel.labels, &row.get("curve").to_string()),
        x,
        y,
        interval: row.number("low").zip(row.number("high")).map(|(low, high)| [low, high]),
        basis: None,
        mark,
        blocks: row.number("blocks").unwrap_or(0.0) as usize,
        rows: row.number("rows").unwrap_or(0.0) as usize,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read_as_they_were_written() {
        let table = Table::of_cells([vec![
            ("dataset".to_owned(), "=1+1".into()),
            ("count".to_owned(), 7u32.into()),
            ("mean".to_owned(), (-1.5e-9).into()),
            ("is".to_owned(), true.into()),
            ("none".to_owned(), Value::Empty),
            ("range".to_owned(), "250..2500".into()),
        ]]);
        assert_eq!(parse_table(&table.to_csv().unwrap()).unwrap(), table);
    }

    #[test]
    fn charts_come_back_from_their_points() {
        let text = "panel,measure,curve,x,y,low,high,blocks,rows,mark\n\
                    all sizes: carmen,error d,gbs,0.1,6.5,6.3,6.7,20,40,3/40\n\
                    all sizes: carmen,error d,rnd,0.1,7,,,20,40,\n\
                    small,error d,gbs,auto,1,,,2,2,\n\
                    runs lost: carmen,share of runs lost [–],gbs,0.1,0.5,,,2,2,\n\
                    small,scans,gbs,auto,7,,,2,2,\n";
        let study = Study::parse(
            "seed = 1\n[[trials]]\nmap = [\"gbs\", \"rnd\"]\nsize = 1\nruns = 1\n\
             [[views.charts]]\nname = \"errors-{split}\"\nx = { column = \"real_percent\", scale = \"log\" }\n\
             y = { column = \"weighted\" }\nparts = [{ title = \"all sizes\", y = \"log\" }, { title = \"small\" }, { title = \"runs lost\", column = \"lost\" }]\n",
        )
        .unwrap();
        let table = parse_table(text.as_bytes()).unwrap();
        let found = chart("errors-same", &table, Some(&study));
        let [all, small, lost, scans] = &found.panels[..] else { panic!("{found:?}") };
        // Two measures under one title were drawn as one curve.
        assert_eq!((scans.part, scans.y.label.as_str(), scans.points.len()), (1, "scans", 1));
        assert_eq!((lost.part, lost.y.label.as_str()), (2, "share of runs lost [–]"));
        assert_eq!((small.y.label.as_str(), small.points.len()), ("error d", 1));
        assert_eq!(all.labels, ["gbs", "rnd"]);
        assert_eq!((all.x.scale, all.y.scale), (Scale::Log, Scale::Log));
        assert_eq!(all.points[0].interval, Some([6.3, 6.7]));
        assert_eq!((all.points[0].mark.as_deref(), all.points[0].rows), (Some("3/40"), 40));
        assert_eq!((all.points[1].curve, all.points[1].interval), (1, None));
        assert_eq!(
            (small.part, small.y.scale, &small.x.places[..]),
            (1, Scale::Linear, &["auto".to_owned()][..])
        );
        // Without a study, values are on a linear scale.
        let bare = chart("errors-same", &table, None);
        assert_eq!((bare.panels[0].x.label.as_str(), bare.panels[0].x.scale), ("x", Scale::Linear));
    }
}
