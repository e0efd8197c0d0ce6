//! Says which real data tests can use, and packs the script of the report's charts.

use std::error::Error;
use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

fn main() -> Result<(), Box<dyn Error>> {
    mcl_real_data::declare();
    pack_plotly()
}

/// plotly.js as the crate carries it, into `plotly.js.gz`: the program includes that, and a page inflates it.
fn pack_plotly() -> Result<(), Box<dyn Error>> {
    // Two elements: plotly.js, and MathJax, which no label here needs.
    let elements = plotly::Plot::offline_js_sources();
    let script = elements.split_once('>').and_then(|(_, rest)| rest.split_once("</script>"));
    let script = script.map(|(script, _)| script).filter(|script| script.contains("plotly.js"));
    let script = script.ok_or("plotly: expected its script as the first element")?;
    let path = Path::new(&std::env::var("OUT_DIR")?).join("plotly.js.gz");
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(script.as_bytes())?;
    Ok(std::fs::write(path, packed.finish()?)?)
}
