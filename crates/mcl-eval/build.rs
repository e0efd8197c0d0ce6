//! Puts the studies of `experiments/` into the program, and packs the script of the report's charts.

use std::error::Error;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

use flate2::Compression;
use flate2::write::GzEncoder;

/// A link to what crates with tests on real data share.
mod real_data;

fn main() -> Result<(), Box<dyn Error>> {
    real_data::main();
    let out = PathBuf::from(env::var("OUT_DIR")?);
    list_studies(&out)?;
    pack_plotly(&out)
}

/// The studies in `experiments/` and in the folder of examples there, as `studies.rs`. In the repository `experiments` is a
/// link to the folder at its top; an archive of the crate has the files.
fn list_studies(out: &Path) -> Result<(), Box<dyn Error>> {
    let folder = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("experiments");
    let mut studies = Vec::new();
    for folder in [folder.clone(), folder.join("examples")] {
        println!("cargo::rerun-if-changed={}", folder.display());
        let entries = fs::read_dir(&folder).map_err(|error| {
            format!(
                "{}: {error}; it is a link, which git makes if core.symlinks is on",
                folder.display()
            )
        })?;
        for entry in entries {
            let path = entry?.path();
            if path.extension().is_some_and(|ending| ending == "toml") {
                let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                studies.push((name, path));
            }
        }
    }
    studies.sort();
    if let Some(pair) = studies.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        return Err(format!("two studies are named {}", pair[0].0).into());
    }
    let mut list = String::from("const BUILT_IN: &[BuiltIn] = &[\n");
    for (name, path) in studies {
        writeln!(list, "    BuiltIn {{ name: {name:?}, text: include_str!({path:?}) }},")?;
    }
    Ok(fs::write(out.join("studies.rs"), list + "];\n")?)
}

/// plotly.js as the crate carries it, into `plotly.js.gz`: the program includes that, and a page inflates it.
fn pack_plotly(out: &Path) -> Result<(), Box<dyn Error>> {
    // Two elements: plotly.js, and MathJax, which no label here needs.
    let elements = plotly::Plot::offline_js_sources();
    let script = elements.split_once('>').and_then(|(_, rest)| rest.split_once("</script>"));
    let script = script.map(|(script, _)| script).filter(|script| script.contains("plotly.js"));
    let script = script.ok_or("plotly: expected its script as the first element")?;
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(script.as_bytes())?;
    Ok(fs::write(out.join("plotly.js.gz"), packed.finish()?)?)
}
