//! Says which build this is: a digest of the sources that rows depend on, and the revision. Rows of different builds are
//! never mixed.
//!
//! In the repository the digest is of the sources of all crates below, and git knows the revision. In an archive of this
//! crate it is of its own sources and of the revision that `cargo package` wrote beside them, which the other crates of
//! the same version share: this crate asks for exactly its version of each.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use sha2::{Digest, Sha256};

/// The crates whose code decides what a row holds.
const CRATES: [&str; 6] =
    ["mcl-core", "mcl-datasets", "mcl-maps", "mcl-filter", "mcl-metrics", "mcl-study"];

fn main() {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let packaged = here.join(".cargo_vcs_info.json");
    let is_packaged = packaged.exists();
    let crates = if is_packaged { here.clone() } else { here.join("..") };
    let mut files = Vec::new();
    let (folders, others): (Vec<PathBuf>, Vec<PathBuf>) = match is_packaged {
        true => (vec![here.join("src")], vec![here.join("Cargo.toml"), packaged.clone()]),
        false => {
            let sources = CRATES.iter().map(|name| crates.join(name).join("src"));
            (sources.collect(), vec![crates.join("..").join("Cargo.lock")])
        }
    };
    for folder in &folders {
        println!("cargo:rerun-if-changed={}", folder.display());
        list(folder, &mut files);
    }
    for file in others {
        println!("cargo:rerun-if-changed={}", file.display());
        files.push(file);
    }
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
    if is_packaged {
        let revision = fs::read_to_string(&packaged).ok().and_then(|text| packaged_revision(&text));
        println!("cargo:rustc-env=MCL_REVISION={}", revision.unwrap_or_default());
        return;
    }
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

/// The revision in `.cargo_vcs_info.json`, as git would say it in the repository.
fn packaged_revision(text: &str) -> Option<String> {
    let (_, rest) = text.split_once("\"sha1\"")?;
    let revision: String = rest.split('"').nth(1)?.chars().take(12).collect();
    let is_dirty = text.split_once("\"dirty\"").is_some_and(|(_, rest)| rest.contains("true"));
    Some(if is_dirty { format!("{revision}+changes") } else { revision })
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
