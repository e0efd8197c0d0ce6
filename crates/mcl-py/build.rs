//! Lets a linker of macOS leave to Python what is Python's, as that of Linux does by itself.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
