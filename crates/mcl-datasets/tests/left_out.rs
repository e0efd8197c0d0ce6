//! What a build without features says of the files that it cannot read (`--no-default-features --test left_out`).
#![cfg(not(feature = "bags"))]

use std::fs;

use mcl_core::Seed;
use mcl_datasets::carmen;
use mcl_datasets::log::{is_bag, read_log};
use mcl_datasets::simulator::{OfficeSettings, simulate};

#[test]
fn what_is_left_out_is_recognized_and_the_feature_named() {
    let folder = tempfile::tempdir().unwrap();
    let begins: [(&str, &[u8], &str, &str); 3] = [
        ("a.mcap", b"\x89MCAP0\r\n", "MCAP files", "bags"),
        ("a.bag", b"#ROSBAG V2.0\n", "ROS 1 bags", "bags"),
        ("a.db3", b"SQLite format 3\0", "databases (.db3)", "sqlite"),
    ];
    for (name, head, format, feature) in begins {
        let path = folder.path().join(name);
        fs::write(&path, [head, &[0; 100]].concat()).unwrap();
        assert!(is_bag(&path).unwrap(), "{name}");
        let message = read_log(&path).unwrap_err().to_string();
        let expected = format!(
            "this build cannot read {format}: it was compiled without the feature `{feature}` of mcl-datasets"
        );
        assert!(message.contains(&expected), "{message}");
    }
    let bag = folder.path().join("split");
    fs::create_dir(&bag).unwrap();
    fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information: {}").unwrap();
    let message = read_log(&bag).unwrap_err().to_string();
    assert!(message.contains("this build cannot read folders of bags"), "{message}");
}

#[test]
fn carmen_logs_are_read_without_any_feature() {
    let office = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("office.log");
    carmen::write(&office, &[], fs::File::create(&path).unwrap()).unwrap();
    assert_eq!(read_log(&path).unwrap().recording.scans.len(), office.scans.len());
}
