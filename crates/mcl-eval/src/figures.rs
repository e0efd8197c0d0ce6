use anyhow::Result;
use mcl_study::store::results::Results;
use std::path::{Path, PathBuf};
pub fn write_ranking(_: &Path, _: &[Results]) -> Result<Option<PathBuf>> {
    Ok(None)
}
pub fn write_tables(_: &Results) -> Result<()> {
    Ok(())
}
pub fn draw(_: &Results) -> Result<Vec<PathBuf>> {
    Ok(Vec::new())
}
