//! Sets the configuration flags that say which real data the tests can use.

fn main() {
    mcl_real_data::declare();
}
