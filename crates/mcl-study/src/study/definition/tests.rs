use super::*;

const SMALL: &str = r#"
seed = 1
measures = ["likelihood"]
[base]
sigma = 0.05
[[trials]]
map = ["gbs", "gbs+f-km", "all"]
size = [1, 2]
draws = 3
[[trials]]
name = "filters"
map = "rnd"
size = 1
sigma_hit = [0.1, 0.2]
alpha = [[0.1, 0.1, 0.1, 0.1], [0.2, 0.2, 0.2, 0.2]]
runs = 2
draws = 2
[[dataset]]
name = "a"
[[dataset.trials]]
map = "occupancy"
resolution = { from = 0.1, to = 0.4, factor = 2 }
[[dataset]]
name = "b"
"#;

fn identities(plan: &Plan, study: &Study) -> Vec<(String, String)> {
    let of_trial = |place| plan.identities_of(place, &study.measures).unwrap();
    (0..plan.trials.len()).flat_map(of_trial).collect()
}

#[test]
fn trials_are_all_combinations_once() {
    let study = Study::parse(SMALL).unwrap();
    let plan = study.plan("b").unwrap();
    // Two kinds at two sizes, three draws; all points, which nothing is drawn for, once; and two
    // draws of a random map with two runs under four settings.
    assert_eq!((plan.trials.len(), plan.rows()), (2 * 2 * 3 + 1 + 2, 2 * 2 * 3 + 1 + 2 * 8));
    let runs: Vec<u32> = plan.trials[13].runs.iter().map(|run| run.run).collect();
    assert_eq!(runs, [0, 2, 0, 2, 0, 2, 0, 2]);
    let identities = identities(&plan, &study);
    let distinct: std::collections::HashSet<_> = identities.iter().map(|i| &i.0).collect();
    assert_eq!(distinct.len(), plan.rows());
    assert_eq!(identities.iter().filter(|(_, entries)| entries == "filters").count(), 16);
    let own = study.plan("a").unwrap();
    let names: Vec<String> = own.trials.iter().map(ToString::to_string).collect();
    assert_eq!(names[1], "occupancy 0.2 m σ 0.05 m #0");
    assert_eq!(names.len(), 3);
}

#[test]
fn mistakes_are_named_with_their_line() {
    for (right, wrong, named) in [
        ("seed = 1", "seed = 1\nsede = 2", "line 3: unknown field `sede`"),
        ("sigma = 0.05", "sigma = -1", "line 5: sigma: -1"),
        ("sigma = 0.05", "sigmma = 1", "line 5: base.sigmma"),
        ("sigma = 0.05", "sigma = [1, 2]", "line 5: base.sigma has 2 values"),
        ("[1, 2]", "[1, 1]", "line 8: trials.size: 1 is listed twice"),
        ("[1, 2]", "[1, 200]", "line 8: size: 200"),
        ("[1, 2]", "[]", "line 8: trials.size: the list is empty"),
        ("draws = 3", "draws = 0", "line 9: trials.draws is 0"),
        ("draws = 3", "draws = 999999", "rows, expected at most"),
        ("\"gbs\"", "\"gsb\"", "line 7: map: \"gsb\""),
        ("[\"likelihood\"]", "[\"likelyhood\"]", "line 3: measures: \"likelyhood\""),
        ("name = \"b\"", "name = \"../b\"", "dataset.name is \"../b\""),
        ("name = \"b\"", "name = \"a\"", "listed twice"),
        ("factor = 2", "factor = 1", "factor is 1"),
        ("sigma_hit = [0.1", "sigma_hit = [-0.1", "sigma_hit"),
        ("size = 1\n", "", "rnd needs size"),
        ("sigma_hit = [0.1", "localizer = [\"amcl\"]\nsigma_hit = [0.1", "expected one of: own"),
    ] {
        let text = SMALL.replacen(right, wrong, 1);
        assert_ne!(text, SMALL, "{wrong}");
        let Err(error) = Study::parse(&text) else { panic!("accepted: {wrong}") };
        let message = format!("{error:#}");
        assert!(message.contains(named), "{wrong}: {message}");
    }
}

const PROGRAM: &str = r#"
seed = 1
[localizer.amcl]
command = ["amcl", "--map={map}", "{bag}", "{output}"]
log = "mcap"
map = "grid"
resolution = 0.05
time_limit = 60
[[trials]]
map = ["all", "gbs"]
size = 1
localizer = ["own", "amcl"]
particles = [100, 200]
runs = 1
"#;

#[test]
fn mistakes_about_programs_are_named_with_their_line() {
    for (right, wrong, named) in [
        ("{map}", "{mapp}", "line 4: localizer.amcl.command: {mapp} is unknown"),
        ("{bag}", "{bag", "line 4: localizer.amcl.command: "),
        ("[localizer.amcl]", "[localizer.own]", "line 3: localizer.own.name"),
        ("resolution = 0.05", "resolution = 0", "line 7: localizer.amcl.resolution: 0"),
        ("resolution = 0.05", "", "line 10: trials: localizer amcl: all is a map of points"),
        ("\"grid\"", "\"csv\"", "line 7: localizer.amcl.resolution: applies only to"),
        ("\"mcap\"", "\"mcapp\"", "line 5: unknown variant `mcapp`"),
        ("time_limit = 60", "time_limit = -1", "line 8: localizer.amcl.time_limit: -1"),
        ("time_limit = 60\n", "", "missing field `time_limit`"),
        ("time_limit = 60", "time_limit = 60\nfiles = [\"../x\"]", "line 9: localizer.amcl.files"),
        ("time_limit = 60", "time_limit = 60\nlimit = 1", "line 9: unknown field `limit`"),
        (
            "\"own\", \"amcl\"",
            "\"own\", \"amc\"",
            "line 12: localizer: \"amc\", expected one of: own, amcl",
        ),
        ("map = [\"all\", \"gbs\"]", "map = \"segments\"\nresolution = 0.1", "points or cells"),
    ] {
        let text = PROGRAM.replacen(right, wrong, 1);
        assert_ne!(text, PROGRAM, "{wrong}");
        let Err(error) = Study::parse(&text) else { panic!("accepted: {wrong}") };
        let message = format!("{error:#}");
        assert!(message.contains(named), "{wrong}: {message}");
    }
}

/// Settings of the built-in filter do not change the runs of a program, and rows depend on program and files.
#[test]
fn a_programs_rows_depend_on_the_program() {
    let identities = |text: &str| {
        let study = Study::parse(text).unwrap();
        let plan = study.plan("a").unwrap();
        let runs = plan.trials[0].runs.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(runs, ["own run 0", "own run 0", "amcl run 0"]);
        let found = identities(&plan, &study);
        found.into_iter().map(|(identity, _)| identity).take(3).collect::<Vec<_>>()
    };
    let before = identities(PROGRAM);
    for (right, wrong) in [
        ("\"amcl\", \"--map", "\"amcl2\", \"--map"),
        ("time_limit = 60", "time_limit = 61"),
        ("time_limit = 60", "time_limit = 60\nposes = \"laser\""),
        ("resolution = 0.05", "resolution = 0.1"),
        ("time_limit = 60", "time_limit = 60\nfiles = [\"x\"]"),
        ("time_limit = 60", "time_limit = 60\nenvironment = { A = \"b\" }"),
    ] {
        let after = identities(&PROGRAM.replacen(right, wrong, 1));
        assert_eq!(before[..2], after[..2], "{wrong}");
        assert_ne!(before[2], after[2], "{wrong}");
    }
    let pinned = "time_limit = 60\nfiles = [\"x\"]";
    let with = |digest: &str| {
        let text = PROGRAM.replacen("time_limit = 60", pinned, 1);
        identities(&format!("{text}\n[digests]\nx = \"{digest}\"\n"))
    };
    assert_ne!(with("0a")[2], with("0b")[2]);
}

/// The text of a study records the digests of the files of its programs.
#[test]
fn files_of_programs_are_pinned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study.toml");
    let text = PROGRAM.replacen("time_limit", "files = [\"x.py\"]\ntime_limit", 1);
    std::fs::write(&path, &text).unwrap();
    let message = format!("{:#}", Study::read(&path).err().unwrap());
    assert!(message.contains("cannot read") && message.contains("x.py"), "{message}");
    std::fs::write(folder.path().join("x.py"), "1").unwrap();
    let study = Study::read(&path).unwrap();
    let sha256 = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b";
    assert_eq!(study.text, format!("{text}\n[digests]\n\"x.py\" = \"{sha256}\"\n"));
    assert_eq!(study.programs()[0].files["x.py"], sha256);
    std::fs::write(&path, &study.text).unwrap();
    assert_eq!(Study::read(&path).unwrap().text, study.text);
    std::fs::write(folder.path().join("x.py"), "2").unwrap();
    let message = format!("{:#}", Study::read(&path).err().unwrap());
    assert!(message.contains("is not the file that [digests] names"), "{message}");
}

/// Every name that a view can get wrong is reported with its line and the valid names.
#[test]
fn mistakes_in_views_are_named_with_their_line() {
    const VIEWS: &str = r#"
[views.summary]
columns = ["log_likelihood"]
kept = ["weighted"]
[[views.factors]]
name = "factor"
x = "map_points"
y = "log_likelihood"
than = "gbs"
[[views.tests]]
y = "log_likelihood"
pairs = [["gbs+f-km", "gbs"]]
[[views.tests]]
of = "filters"
y = "weighted"
column = "alpha"
pairs = [["(0.1, 0.1, 0.1, 0.1)", "(0.2, 0.2, 0.2, 0.2)"]]
[[views.charts]]
name = "chart-{split}"
x = { column = ["map_points", "size_percent"] }
y = { column = "factor" }
curves = ["map"]
parts = [{ title = "small", sizes = [0, 1] }]
[[views.charts]]
name = "settings"
of = "filters"
y = { column = "weighted" }
marks = "diverged"
[[views.pictures]]
name = "picture"
maps = [{ map = "all" }, { map = "gbs", size = 1 }]
[views.ranking]
of = ["filters"]
y = "weighted"
"#;
    let right_text = format!("{SMALL}{VIEWS}");
    let lines = SMALL.lines().count();
    Study::parse(&right_text).unwrap();
    for (right, wrong, line, named) in [
        ("kept = [\"weighted\"]", "kept = [\"wheighted\"]", 4, "views.summary.kept"),
        ("name = \"factor\"", "name = \"map_points\"", 6, "views.factors.0.name"),
        ("x = \"map_points\"", "x = \"points\"", 7, "\"points\", expected"),
        ("hood\"\nthan", "hod\"\nthan", 8, "\"log_likelihod\", expected one of: "),
        ("than = \"gbs\"", "than = \"gbs+best\"", 9, "no map \"gbs+best\""),
        ("\"gbs\"]]", "\"rdn\"]]", 12, "\"rdn\", expected one of: all, gbs"),
        ("of = \"filters\"\ny", "of = \"filter\"\ny", 14, "views.tests.1.of"),
        ("column = \"alpha\"", "column = \"beta\"", 16, "no setting \"beta\""),
        ("(0.2, 0.2, 0.2, 0.2)", "0.2", 17, "(0.1, 0.1, 0.1, 0.1)"),
        ("{split}", "{spilt}", 19, "no setting \"spilt\""),
        ("chart-{split}", "../{split}", 19, "not a file name"),
        ("\"size_percent\"]", "\"size\"]", 20, "views.charts.0.x.column"),
        ("column = \"factor\"", "column = \"size_percent\"", 21, "views.charts.0.y.column"),
        ("curves = [\"map\"]", "curves = [\"weighted\"]", 22, "no setting"),
        ("sizes = [0, 1]", "sizes = [1, 0]", 23, "the smaller first"),
        ("name = \"settings\"", "name = \"chart-{split}\"", 25, "used twice"),
        ("marks = \"diverged\"", "marks = \"divergd\"", 28, "views.charts.1.marks"),
        ("name = \"picture\"", "name = \"settings\"", 30, "used twice"),
        ("{ map = \"gbs\", size = 1 }", "{ map = \"gbs\" }", 31, "needs size"),
        ("of = [\"filters\"]", "of = [\"a\"]", 33, "views.ranking.of"),
    ] {
        let text = right_text.replacen(right, wrong, 1);
        assert_ne!(text, right_text, "{wrong}");
        let Err(error) = Study::parse(&text) else { panic!("accepted: {wrong}") };
        let message = format!("{error:#}");
        let line = format!("line {}: views.", lines + line);
        assert!(message.starts_with(&line) && message.contains(named), "{wrong}: {message}");
    }
}
