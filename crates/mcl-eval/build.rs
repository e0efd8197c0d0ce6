//! Says which real data tests can use.

fn main() {
    mcl_real_data::declare();
}
