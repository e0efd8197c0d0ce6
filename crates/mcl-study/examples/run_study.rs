//! A study from its text: how likely maps of two sizes are, on the first 20 scans of the simulated office.

use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::run::run_study;
use mcl_study::share::Share;
use mcl_study::store::identity::Build;
use mcl_study::study::definition::Study;
use mcl_study::trial::division::StudyData;

const STUDY: &str = r#"
seed = 1
measures = ["likelihood"]
[base]
sigma = 0.05
[[trials]]
map = ["gbs", "gbs+f-km"]
size = [2, 5]
draws = 1
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let study = Study::parse(STUDY)?;
    let log = LogSource::open("simulated-office", &SourceOptions::default())?.first_scans(20);
    let data = StudyData::new(DataSource::Log(log));
    let folder = tempfile::tempdir()?;
    let share = Share::Whole { fresh: false };
    let ran = run_study(&study, "sizes", &data, folder.path(), share, |_| {})?;
    let results = ran.results.ok_or("a whole run has results")?;
    println!("build {}", Build::this());
    for row in results.table.rows() {
        let number = |column| row.number(column).unwrap_or(f64::NAN);
        println!(
            "{} {} %: {} points, {:.1} nats per point",
            row.text("map"),
            number("size_percent"),
            number("map_points"),
            number("log_likelihood")
        );
    }
    Ok(())
}
