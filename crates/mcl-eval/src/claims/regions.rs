//! Regions where statements hold among the values of two settings: `[[views.regions]]` of a study.

use anyhow::Result;
use mcl_core::text::counted;
use mcl_study::store::results::Results;
use mcl_study::study::settings::text_of;
use mcl_study::study::views::Region;
use mcl_study::table::{Table, Value};
use mcl_study::view::caption::{caption, maps_and_runs};
use mcl_study::view::groups::{Group, Groups, same_values};
use mcl_study::view::layout::distinct;

use crate::claims::cells::Sampled;
use crate::claims::claim::{ALPHA, Claim};
use crate::claims::localization::CLAIMS;

/// The statements about localization, decided for every combination of two settings.
pub struct Verdicts<'r> {
    /// The study's definition.
    pub view: &'r Region,
    /// The values of x and y, names in the order of the study and numbers ascending.
    pub values: [Vec<Vec<Value>>; 2],
    /// The claims of every combination, with the indices of its values.
    pub cells: Vec<([usize; 2], Vec<Claim>)>,
    /// Paragraphs of the caption.
    pub caption: Vec<String>,
}

/// The regions of a study on a data set, for entries that have trials on it. With trials missing every claim
/// is not testable.
///
/// # Errors
/// When a value cannot be computed with.
pub fn regions(results: &Results) -> Result<Vec<Verdicts<'_>>> {
    let views = &results.study.views.regions;
    if views.is_empty() {
        return Ok(Vec::new());
    }
    let groups = Groups::of(results)?;
    let mut found = Vec::new();
    for view in views {
        let parts = Sampled::parts(&groups, Some(&view.of), &[&view.x, &view.y], true)?;
        let (Some(x), Some(y), false) =
            (groups.place(&view.x), groups.place(&view.y), parts.is_empty())
        else {
            continue;
        };
        let is_own = |group: &&Group<'_>| group.entries.contains(&view.of);
        let shown: Vec<&Group<'_>> = groups.all.iter().filter(is_own).collect();
        let values = [x, y].map(|place| distinct(&groups, &shown, place));
        let place = |axis: usize, own: &[Value]| {
            values[axis].iter().position(|known| same_values(known, own)).unwrap_or(0)
        };
        let decided = parts
            .into_iter()
            .map(|(own, data)| ([place(0, &own[0]), place(1, &own[1])], data.claims(&CLAIMS)));
        let mut cells: Vec<_> = decided.collect();
        cells.sort_by_key(|(at, _)| *at);
        let counts: Vec<_> = shown.iter().map(|group| (group.blocks(), group.rows.len())).collect();
        let of_what = maps_and_runs(&counts, true).unwrap_or_else(|| counted(0, "map"));
        let method = format!(
            "Each cell is decided by its own runs, as mcl-eval claims does (α = {ALPHA}). The number is \
             the effect behind the verdict: a ratio of errors; in the last two panels the share of lost \
             runs, and how much larger it is below 0.25 %."
        );
        let of_what = format!("Of each kind and size {of_what}");
        let own = (!view.caption.is_empty()).then(|| view.caption.clone());
        let beneath = [method, caption(&groups, &shown, &of_what, true)];
        let caption = own.into_iter().chain(beneath).collect();
        found.push(Verdicts { view, values, cells, caption });
    }
    Ok(found)
}

impl Verdicts<'_> {
    /// A row per combination and claim.
    pub fn to_table(&self) -> Table {
        const COLUMNS: &str = "claim verdict p effect low high blocks effect_of measured";
        let settings = [self.view.x.as_str(), &self.view.y];
        let mut table = Table::new(settings.into_iter().chain(COLUMNS.split(' ')));
        for (at, claims) in &self.cells {
            for claim in claims {
                let settings = [0, 1].map(|axis| match &self.values[axis][at[axis]][..] {
                    [one] => one.clone(),
                    several => text_of(several).into(),
                });
                let evidence = &claim.evidence;
                let numbers = [evidence.p, evidence.effect, evidence.low, evidence.high];
                let mut row = settings.to_vec();
                row.extend([claim.id.into(), <&str>::from(claim.verdict).into()]);
                row.extend(numbers.map(Value::from));
                row.extend([evidence.blocks.into(), evidence.effect_of.clone().into()]);
                row.push(claim.measured.as_str().into());
                table.push(row);
            }
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::claim::Verdict::{self, *};
    use crate::claims::planted::{self, PlantedRow};

    fn study(settings: &str, y: &str, fill: impl FnMut(&mut PlantedRow)) -> Results {
        let text = format!(
            "[[trials]]\nname = \"region\"\nmap = [\"gbs\", \"gbs+f-km\", \"rnd\", \"rnd+f-km\"]\n\
             size = [0.25, 1, 2]\ndraws = 3\nruns = 2\n{settings}\n\
             [[trials]]\nname = \"other\"\nmap = \"gbs\"\nsize = 5\nruns = 1\nbeam_floor = 0.1\n\
             [[views.regions]]\nname = \"where\"\nof = \"region\"\nx = \"beam_floor\"\ny = \"{y}\"\n"
        );
        planted::study("region", &text, fill)
    }

    /// Lost on grid-based maps of 0.25 % under a low floor and a wide field, and on those of another entry.
    fn fill(row: &mut PlantedRow) {
        let is_low = row.number("beam_floor") < 0.2 && row.number("sigma_hit") == 0.3;
        let size = row.number("size_percent");
        let is_lost = size == 5.0 || is_low && size == 0.25 && row.text("map") == "gbs";
        let of_run = 1.0 + 0.1 * row.number("draw") + 0.01 * row.number("run");
        row.set("weighted", of_run * if is_lost { 4.0 } else { 0.03 });
        row.set("diverged", is_lost);
    }

    fn verdicts(region: &Verdicts<'_>, id: &str) -> Vec<([usize; 2], Verdict)> {
        let of = |claims: &[Claim]| claims.iter().find(|claim| claim.id == id).unwrap().verdict;
        region.cells.iter().map(|(at, claims)| (*at, of(claims))).collect()
    }

    const SETTINGS: &str = "beam_floor = [0.4, 0.1]\nsigma_hit = [0.2, 0.3]";

    #[test]
    fn statements_hold_in_a_region() {
        let results = study(SETTINGS, "sigma_hit", fill);
        let region = &regions(&results).unwrap()[0];
        let expected = [
            ([0, 0], Reproduced),
            ([0, 1], NotReproduced),
            ([1, 0], Reproduced),
            ([1, 1], Reproduced),
        ];
        assert_eq!(verdicts(region, "localization-recovers"), expected);
        let table = region.to_table();
        let lost = table
            .rows()
            .find(|row| {
                row.text("verdict") == "not reproduced"
                    && row.text("claim") == "localization-recovers"
            })
            .unwrap();
        assert_eq!([lost.number("beam_floor"), lost.number("sigma_hit")], [Some(0.1), Some(0.3)]);
        assert_eq!((table.len(), lost.number("effect")), (4 * 7, Some(6.0 / 72.0)));
        assert!(lost.text("measured").starts_with("6 of 72 runs diverged"), "{lost:?}");
        let [.., described] = &region.caption[..] else { panic!("{:?}", region.caption) };
        assert!(described.contains("Of each kind and size 3 maps, 2 runs on each"), "{described}");
    }

    /// The cells are decided by the same code as claims.
    #[test]
    fn a_combination_has_the_verdicts_of_a_study_of_it() {
        let all = study(SETTINGS, "sigma_hit", fill);
        let alone = planted::study(
            "alone",
            "[[trials]]\nmap = [\"gbs\", \"gbs+f-km\", \"rnd\", \"rnd+f-km\"]\nsize = [0.25, 1, 2]\n\
             draws = 3\nruns = 2\nbeam_floor = 0.1\nsigma_hit = 0.3\n",
            fill,
        );
        let alone = Sampled::of(&alone, "weighted", true).unwrap()[0].claims(&CLAIMS);
        let (_, claims) = &regions(&all).unwrap()[0].cells[1];
        for (a, b) in claims.iter().zip(&alone) {
            let of = |claim: &Claim| (claim.id, claim.verdict, claim.measured.clone());
            assert_eq!((of(a), &a.evidence), (of(b), &b.evidence));
        }
        assert_eq!(claims.len(), alone.len());
    }

    #[test]
    fn half_a_study_has_no_verdict() {
        let mut results = study(SETTINGS, "sigma_hit", fill);
        planted::edit(&mut results, |row| row.number("beam_floor") != 0.4);
        results.done -= 1;
        let region = &regions(&results).unwrap()[0];
        // Combinations without a row have a cell, too.
        assert_eq!(region.cells.len(), 4);
        let claims = || region.cells.iter().flat_map(|(_, claims)| claims);
        assert!(claims().all(|claim| claim.verdict == NotTestable), "{:?}", region.cells);
        assert!(claims().all(|claim| claim.measured.ends_with("trials are there")));
    }

    /// Presets differ in many settings, which vary with them.
    #[test]
    fn presets_are_values() {
        let results =
            study("beam_floor = [0.1, 0.4]\npreset = [\"carmen\", \"book\"]", "preset", fill);
        let region = &regions(&results).unwrap()[0];
        assert_eq!(region.values[1], [["carmen".into()], ["book".into()]]);
        assert_eq!(verdicts(region, "localization-recovers")[3], ([1, 1], Reproduced));
        assert_eq!(region.cells[1].1[0].place.preset.as_deref(), Some("book"));
    }
}
