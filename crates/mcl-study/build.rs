//! Says which build this is: a digest of the sources that rows depend on, and the revision where git
//! knows it. Rows of different builds are never mixed.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use sha2::{Digest, Sha256};

/// The crates whose code decides what a row holds.
const CRATES: [&str; 6] =
    ["mcl-core", "mcl-datasets", "mcl-maps", "mcl-filter", "mcl-metrics", "mcl-study"];

fn main() {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let crates = here.join("..");
    let mut files = Vec::new();
    // In a package that was built from its own archive there are no neighbours: then the versions of
    // the dependencies are all there is to know, and `Cargo.lock` has them.
    for name in CRATES {
        let folder = crates.join(name).join("src");
        println!("cargo:rerun-if-changed={}", folder.display());
        list(&folder, &mut files);
    }
    let lock = crates.join("..").join("Cargo.lock");
    println!("cargo:rerun-if-changed={}", lock.display());
    files.push(lock);
    files.sort();
    let mut digest = Sha256::new();
    for file in files {
        let Ok(content) = fs::read(&file) else { continue };
        let name = file.strip_prefix(&crates).unwrap_or(&file);
        digest.update(name.to_string_lossy().as_bytes());
        digest.update((content.len() as u64).to_le_bytes());
        digest.update(content);
    }
    let hex: String = digest.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    println!("cargo:rustc-env=MCL_SOURCES={hex}");

    let git = |arguments: &[&str]| {
        let output = Command::new("git").current_dir(&here).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // The sources may lie in somebody else's repository.
    let is_ours = git(&["ls-files", "--error-unmatch", "build.rs"]).is_some();
    let revision = git(&["rev-parse", "--short=12", "HEAD"]).filter(|_| is_ours);
    let is_dirty = git(&["status", "--porcelain", "--", ".."]).is_some_and(|text| !text.is_empty());
    if let Some(head) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo:rerun-if-changed={}", here.join(head).display());
    }
    let revision = revision.map(|name| if is_dirty { format!("{name}+changes") } else { name });
    println!("cargo:rustc-env=MCL_REVISION={}", revision.unwrap_or_default());
}

/// The files below a folder.
fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        match path.is_dir() {
            true => list(&path, files),
            false => files.push(path),
        }
    }
}
