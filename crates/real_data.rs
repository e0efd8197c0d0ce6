//! The build script of crates with tests on real data: sets what is at hand as configuration, so that tests that need some
//! of it are counted as ignored where it is not, instead of passing without having seen it:
//!
//! ```text
//! #[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
//! ```
//!
//! The crates hold links to this file. It is no crate, and in no archive: who depends on theirs builds nothing for it.

use std::path::PathBuf;

/// Folders of data sets, of archives of bags, and of bags.
const FOLDERS: [&str; 3] = ["MCL_DATA_DIR", "MCL_MCAP_DIR", "MCL_BAG_DIR"];

/// Sets `cfg(real_data = "NAME")` for every file or folder NAME in the folders that `MCL_DATA_DIR`,
/// `MCL_MCAP_DIR` and `MCL_BAG_DIR` name, and `cfg(real_data)` where there is one.
pub fn main() {
    println!("cargo::rustc-check-cfg=cfg(real_data, values(any()))");
    for variable in FOLDERS {
        println!("cargo::rerun-if-env-changed={variable}");
        let Some(folder) = std::env::var_os(variable).map(PathBuf::from) else { continue };
        println!("cargo::rerun-if-changed={}", folder.display());
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        println!("cargo::rustc-cfg=real_data");
        for name in entries.flatten().filter_map(|entry| entry.file_name().into_string().ok()) {
            // Others would not be one line of text in quotes.
            if name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte)) {
                println!("cargo::rustc-cfg=real_data=\"{name}\"");
            }
        }
    }
}
