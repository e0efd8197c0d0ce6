//! Writes the inputs that the corpus began with: short pieces of the simulated office in every format,
//! and texts by hand. Fuzzing adds to them what reaches further.
//!
//! ```text
//! cargo run -p mcl-fuzz --example seeds -- FOLDER
//! ```

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::{PointMap, Pose2, Recording, ScanGeometry, Seed, Stamp};
use mcl_datasets::bag::{self, Encoder, Format, planar, types};
use mcl_datasets::carmen;
use mcl_datasets::container;
use mcl_datasets::container::item::Item;
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_fuzz::bag_of_one_message;
use mcl_maps::files::{Encoding, PointFormat, encode_grid};
use mcl_maps::occupancy::rasterize;
use mcl_metrics::tum;
use mcl_study::data::source::{DataSource, LogSource};
use mcl_study::run::run_study;
use mcl_study::share::Share;
use mcl_study::study::definition::Study;
use mcl_study::trial::division::StudyData;
use serde_json::{Value, json};

/// Where the first chunk of a bag of ROS 1 begins: after its first line and the record of 4096 bytes.
const CHUNK_START: usize = 13 + 4096;

struct Corpus(PathBuf);

impl Corpus {
    fn add(&self, target: &str, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
        let folder = self.0.join(target);
        std::fs::create_dir_all(&folder)?;
        Ok(std::fs::write(folder.join(name), bytes)?)
    }
}

/// The first scans of the office, with few beams.
fn piece(scans: usize, beams: usize) -> Result<Recording> {
    let mut recording = simulate(&OfficeSettings::default(), Seed::new(1))?;
    recording.scans.truncate(scans);
    for scan in &mut recording.scans {
        let every = scan.ranges.len() / beams;
        scan.ranges = scan.ranges.iter().step_by(every).take(beams).copied().collect();
        let ScanGeometry { start_angle, angle_step, .. } = scan.geometry;
        scan.geometry = ScanGeometry { start_angle, angle_step: angle_step * every as f64, beams };
    }
    Ok(recording)
}

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).context("expected the folder of the corpus")?;
    let corpus = Corpus(folder.into());
    logs(&corpus)?;
    messages(&corpus)?;
    maps(&corpus)?;
    texts(&corpus)
}

fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(bytes)?;
    Ok(packed.finish()?)
}

/// A database with the smallest pages, so that it is no longer than what is fuzzed.
fn small(database: &[u8]) -> Result<Vec<u8>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("bag.db3");
    std::fs::write(&path, database)?;
    let connection = rusqlite::Connection::open(&path)?;
    connection.execute_batch("PRAGMA page_size = 512; VACUUM;")?;
    connection.close().map_err(|(_, error)| error)?;
    Ok(std::fs::read(&path)?)
}

fn logs(corpus: &Corpus) -> Result<()> {
    let with_reference = piece(3, 4)?;
    let mut raw = with_reference.clone();
    for scan in &mut raw.scans {
        scan.map_from_laser = None;
    }
    let mut mounted = with_reference.clone();
    mounted.robot_from_laser = Pose2::new(0.2, 0.1, 0.3);
    for (name, recording) in [("reference", with_reference), ("raw", raw), ("mounted", mounted)] {
        let mut text = Vec::new();
        carmen::write(&recording, &["the simulated office"], &mut text)?;
        corpus.add("carmen", name, &text)?;
        corpus.add("log", name, &text)?;
        corpus.add("log", &format!("{name}.gz"), gzip(&text)?)?;
        let bag = bag::write(&recording, Cursor::new(Vec::new()))?.into_inner();
        corpus.add("log", &format!("{name}.mcap.gz"), gzip(&bag)?)?;
        corpus.add("mcap", name, &bag)?;
        let mut swept = recording.clone();
        swept.scans.iter_mut().for_each(|scan| scan.sweep.time_increment = 0.125);
        for (kind, recording) in [("", &recording), ("-swept", &swept)] {
            let ros1 =
                bag::write_as(recording, Format::Ros1, Cursor::new(Vec::new()))?.into_inner();
            corpus.add("ros1_bag", &format!("{name}{kind}"), &ros1)?;
            // Between the lengths of the only chunk and its index.
            let start = CHUNK_START
                + ros1[CHUNK_START..].windows(4).position(|w| w == b"size").unwrap_or(0)
                + 13;
            let size =
                ros1[start - 4..start].first_chunk().map_or(0, |size| u32::from_le_bytes(*size));
            let records = &ros1[start..start + size as usize];
            for packed in 0..3_u8 {
                corpus.add(
                    "ros1_chunk",
                    &format!("{name}{kind}-{packed}"),
                    [&[packed], records].concat(),
                )?;
            }
            let database = bag::write_as(recording, Format::Database, Cursor::new(Vec::new()))?;
            corpus.add("database", &format!("{name}{kind}"), small(database.get_ref())?)?;
        }
        let mut records = Vec::new();
        container::mcap::read_stream(&*bag, |item| {
            collect(&mut records, item);
            Ok(())
        })?;
        for kind in 0..3_u8 {
            corpus.add("mcap_chunk", &format!("{name}-{kind}"), [&[kind], &*records].concat())?;
        }
    }
    let readings = ["1.5"; 180].join(" ");
    let kinds = format!(
        "PARAM robot_frontlaser_offset 0.25 0 nohost 0\nSYNC 0\nNEFF 12.5\n\
         ODOM 1 2 0 0 0 0 0.5 nohost 0.5\nFLASER 180 {readings} 1 2 0.1 1 2 0.1 1.5 nohost 1.5\n\
         ODOM 1 2 0.1 0 0 0 6.9e-310 nohost 0\nODOM 1.1 2 0.1 0 0 0 2 nohost 2\n\
         FLASER 180 {readings} 1.2 2 0.1 1.2 2 0.1 2.5 nohost 2.5\n"
    );
    corpus.add("carmen", "flaser", &kinds)?;
    corpus.add(
        "carmen",
        "robotlaser",
        "ROBOTLASER1 0 -1.5 3.0 1.5 81.9 0.01 0 3 1 nan inf 2 7 8 0.3 0 0 0.1 0 0 0 0 0.1 0.1 0 3.25 host 1\n\
         ODOM 0.5 0 0 0 0 0 4 h 4\n\
         ROBOTLASER1 0 -1.5 3.0 -1.5 81.9 0.01 0 1 1e3 0 0.8 0 0 0.6 0 0 0 0 0.1 0.1 0 5 host 1\n",
    )?;
    corpus.add(
        "carmen",
        "mode",
        b"PARAM mcl_reference_poses none\nODOM 1 2 3\nFLASER 2 1 1\n\xff",
    )?;
    corpus.add(
        "bag_metadata",
        "split",
        "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  duration:\n    \
         nanoseconds: 5\n  relative_file_paths:\n    - bag_0.mcap\n    - \"bag_1.mcap\"\n  \
         compression_format: \"\"\n  compression_mode: \"\"\n",
    )?;
    corpus.add(
        "bag_metadata",
        "sqlite",
        "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths: [a.db3], \
         compression_mode: FILE}\n",
    )?;
    corpus.add(
        "bag_metadata",
        "aliases",
        "a: &a [x, x, x]\nb: &b [*a, *a, *a]\nrosbag2_bagfile_information: &i\n  \
         storage_identifier: mcap\n  relative_file_paths: *b\n",
    )
}

/// Schemas, channels and messages as they stand in chunks.
fn collect(records: &mut Vec<u8>, item: Item<'_>) {
    let mut record = |opcode: u8, body: &[u8]| {
        records.push(opcode);
        records.extend((body.len() as u64).to_le_bytes());
        records.extend(body);
    };
    let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
    match item {
        Item::Channel(channel) => {
            let id = (channel.id + 1).to_le_bytes();
            if let Some(schema) = &channel.schema {
                let (name, encoding) = (schema.name.as_bytes(), schema.encoding.as_bytes());
                let texts = [text(name), text(encoding), text(&schema.data)].concat();
                record(3, &[&id[..], &texts].concat());
            }
            let texts = [text(channel.topic.as_bytes()), text(channel.message_encoding.as_bytes())];
            record(4, &[&id[..], &id[..], &texts.concat(), &[0; 4]].concat());
        }
        Item::Message(message) => {
            let id = (message.channel.id + 1).to_le_bytes();
            let head = [&id[..], &message.sequence.to_le_bytes()].concat();
            let times = [message.log_time.to_le_bytes(), message.publish_time.to_le_bytes()];
            record(5, &[head, times.concat(), message.data.to_vec()].concat());
        }
        Item::Passed(_) | Item::Damaged(_) | Item::Note(_) | Item::Metadata(..) => {}
    }
}

fn messages(corpus: &Corpus) -> Result<()> {
    let second = Stamp::from_nanoseconds(1_000_000_000);
    let recording = piece(1, 4)?;
    let scan = planar::laser_scan(&recording.scans[0], second, "laser", (0.0, 30.0)).into_bytes();
    let pose = Pose2::new(1.0, 2.0, 0.5);
    let reference = planar::pose_stamped(second, "map", pose).into_bytes();
    let covariance = Encoder::default().header(second, "map").pose(pose).f64s(&[0.0; 36]).clone();
    let tf =
        planar::transforms(second, &[("base_link", "laser", pose), ("odom", "base_link", pose)])
            .into_bytes();
    let mut odometry = Encoder::default();
    odometry.header(second, "odom").text("base_link").pose(pose).f64s(&[0.0; 36 + 6 + 36]);
    let bodies = [
        (&types::LASER_SCAN, scan),
        (&types::ODOMETRY, odometry.into_bytes()),
        (&types::POSE_STAMPED, reference),
        (&types::POSE_WITH_COVARIANCE_STAMPED, covariance.into_bytes()),
        (&types::TF_MESSAGE, tf.clone()),
        (&types::TF_MESSAGE, tf),
    ];
    for (kind, (message, body)) in (0_u8..).zip(bodies) {
        let description = message.description().replace(&"=".repeat(80), "===");
        let name = message.name.rsplit('/').next().unwrap_or_default();
        let input = [&[kind << 1], description.as_bytes(), &[0], &*body].concat();
        corpus.add("cdr", &format!("{name}-{kind}"), input)?;
        corpus.add("mcap", &format!("{name}-{kind}"), {
            bag_of_one_message("/scan", message.name, &description, &body)
        })?;
    }
    let idl = "===\nIDL: sensor_msgs/msg/LaserScan\n// made by hand\nmodule sensor_msgs { module msg {\n\
        module C { const long MANY = 3; };\n typedef float few__3[MANY];\n\
        @verbatim (language=\"comment\", text=\"a \\\"(\" \"b\")\n struct LaserScan {\n\
        std_msgs::msg::Header header; float angle_min, angle_max; @unit (value=\"rad\")\n\
        float angle_increment; float range_min; double range_max; sequence<float> ranges;\n\
        sequence<unsigned long long, 4> big; string<5> label; few__3 few; octet raw[2][3]; }; }; };\n\
        ===\nIDL: std_msgs/msg/Header\nmodule std_msgs { module msg { struct Header {\n\
        builtin_interfaces::msg::Time stamp; string frame_id; }; }; };\n";
    let mut body = Encoder::default();
    body.header(second, "laser").f32(-0.5).f32(0.5).f32(0.5).f32(0.0).f64s(&[30.0]).u32(3);
    body.f32(1.0).f32(2.0).f32(3.0).u32(0).text("abc").f32(0.0).f32(0.0).f32(0.0).bytes(&[0; 6]);
    corpus.add("cdr", "idl", [&[1], idl.as_bytes(), &[0], &*body.into_bytes()].concat())
}

fn maps(corpus: &Corpus) -> Result<()> {
    let points = vec![[0.5, -0.25], [1.0, 2.0], [-0.0, 5e-324], [1e9, 0.1]];
    let (planar, spatial) = (
        PointMap::new(points.clone())?,
        PointMap::new(points.iter().map(|&[x, y]| [x, y, 0.5]).collect())?,
    );
    for (target, format) in [
        ("map_csv", PointFormat::Csv),
        ("map_ply", PointFormat::Ply),
        ("map_pcd", PointFormat::Pcd),
    ] {
        for (name, encoding) in [("binary", Encoding::Binary), ("ascii", Encoding::Ascii)] {
            let (mut flat, mut high) = (Vec::new(), Vec::new());
            format.write(&planar, encoding, &mut flat)?;
            format.write(&spatial, encoding, &mut high)?;
            corpus.add(target, &format!("{name}-2"), flat)?;
            corpus.add(target, &format!("{name}-3"), high)?;
        }
    }
    corpus.add(
        "map_csv",
        "columns",
        "# made by hand\r\nz , \"name\",Y,x\r\n0,a,1.5,-2\r\n0,,.5,1e3\r\n",
    )?;
    corpus.add(
        "map_ply",
        "lists",
        "ply\nformat ascii 1.0\ncomment made by hand\nelement face 1\nproperty list uchar int vertex_indices\n\
         element vertex 2\nproperty float x\nproperty uchar red\nproperty double y\nproperty list uchar float extra\n\
         end_header\n3 0 1 2\n0.5 255 1.5 2 1 2\n.5 0 -1 0\n",
    )?;
    let big = "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty short x\nproperty float y\nend_header\n";
    corpus.add("map_ply", "big-endian", [big.as_bytes(), &[0, 7, 0x3f, 0x80, 0, 0]].concat())?;
    let head = "# .PCD v.7\nVERSION 0.7\nFIELDS x _ y\nSIZE 4 1 8\nTYPE F U F\nCOUNT 1 3 1\nWIDTH 1\nHEIGHT 1\n\
        VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA ";
    let row = [&1.5_f32.to_le_bytes()[..], &[1, 2, 3], &2.5_f64.to_le_bytes()].concat();
    corpus.add("map_pcd", "padding", [head.as_bytes(), b"binary\n", &*row].concat())?;
    // One run of 15 literal bytes is LZF, too.
    let sizes = [16_u32.to_le_bytes(), 15_u32.to_le_bytes()].concat();
    let packed = [head.as_bytes(), b"binary_compressed\n", &*sizes, &[14], &*row].concat();
    corpus.add("map_pcd", "compressed", packed)?;
    corpus.add("map_pcd", "text", [head.as_bytes(), b"ascii\n1.5 1 2 3 2.5\n"].concat())?;

    let small = PointMap::new(vec![[0.0, 0.0], [0.2, 0.1]])?;
    let (description, image) = encode_grid(&rasterize(&small, 0.05, None)?, "map.pgm");
    corpus.add("map_grid", "written", [description.as_bytes(), &[0], &*image].concat())?;
    let scale = "image: \"a.png\"\nmode: scale\nresolution: 5e-2\norigin: [1, -2.0, 0.5]\nnegate: true\n\
        occupied_thresh: 0.65\nfree_thresh: 0.2\n";
    for (name, color, depth, pixels) in [
        ("grey", png::ColorType::Grayscale, png::BitDepth::Sixteen, 2),
        ("bits", png::ColorType::Grayscale, png::BitDepth::One, 1),
        ("rgba", png::ColorType::Rgba, png::BitDepth::Eight, 4),
    ] {
        let mut image = Vec::new();
        let mut encoder = png::Encoder::new(&mut image, 1, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let rows: Vec<u8> = (0..2 * pixels).map(|byte| byte * 30).collect();
        encoder.write_header()?.write_image_data(&rows)?;
        corpus.add("map_grid", name, [scale.as_bytes(), &[0], &*image].concat())?;
    }
    let plain = description.replace("trinary", "raw");
    corpus.add(
        "map_grid",
        "plain",
        [plain.as_bytes(), b"\0P2 # c\n2 2\n65535\n0 100 65535 7\n"].concat(),
    )
}

fn texts(corpus: &Corpus) -> Result<()> {
    let mut trajectory = Vec::new();
    tum::write(&mut trajectory, &piece(4, 1)?.stamped_reference())?;
    corpus.add("tum", "office", trajectory)?;
    corpus.add(
        "tum",
        "edges",
        "\u{feff}# t x y z qx qy qz qw\n1.5 1 2 0.0005 0 0 .5 0.5\n1e0 -1e9 2 0 0 0 -1 0\r\n\n0 0 0 1 0.1 0.2 0.3 0.4\n",
    )?;
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for name in ["simulated-office", "freiburg-079"] {
        let text = std::fs::read(root.join("datasets").join(name).join("dataset.toml"))?;
        corpus.add("dataset", name, text)?;
    }
    for entry in std::fs::read_dir(root.join("experiments"))? {
        let path = entry?.path();
        if path.extension() == Some("toml".as_ref()) {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            corpus.add("study", &name, std::fs::read(&path)?)?;
        }
    }
    for (name, study) in [("likelihood", LIKELIHOOD), ("localization", LOCALIZATION)] {
        let (manifest, rows) = results(study)?;
        corpus.add("parts", name, &rows)?;
        corpus.add("results", name, [manifest, study.to_owned(), rows].join("\0"))?;
    }
    let (_, rows) = results(LIKELIHOOD)?;
    let first = rows.lines().next().unwrap_or_default();
    let failed = "{\"failed\":{\"trial\":\"gbs #0\",\"reason\":\"no \\\"points\\\"\"}}";
    corpus.add("parts", "failed", format!("{first}\n{failed}\n{failed}"))?;
    corpus.add(
        "parts",
        "other-build",
        first.replace("0123456789abcdef", "0") + "\n" + failed + "\n",
    )
}

/// The manifest and the rows of a study on a piece of the office, without their digests, as if of the
/// identity that the targets compare with.
fn results(study: &str) -> Result<(String, String)> {
    let log =
        LogSource { title: "Lab".to_owned(), ..LogSource::of_recording("lab", piece(12, 30)?) };
    let folder = tempfile::tempdir()?;
    let data = StudyData::new(DataSource::Log(log));
    run_study(
        &Study::parse(study)?,
        "study",
        &data,
        folder.path(),
        Share::Whole { fresh: false },
        |_| {},
    )?;
    let identity = |mut identity: Value| {
        identity["build"] =
            json!({ "version": "0.1.0", "revision": null, "sources": "0123456789abcdef" });
        identity["data"]["sha256"] = json!("00");
        identity["data"]["points"] = json!(300);
        identity
    };
    let mut manifest: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("manifest.json"))?)?;
    manifest["identity"] = identity(manifest["identity"].take());
    let mut rows = String::new();
    for entry in std::fs::read_dir(folder.path().join("parts"))? {
        for line in std::fs::read_to_string(entry?.path())?.lines() {
            let mut line = serde_json::from_str::<Value>(line)?["line"].take();
            if line["identity"].is_object() {
                line["identity"] = identity(line["identity"].take());
            }
            rows += &format!("{line}\n");
        }
    }
    Ok((format!("{manifest}\n"), rows))
}

const LIKELIHOOD: &str = "seed = 1\nmeasures = [\"likelihood\"]\n[base]\ntolerance = 1e-2\n[[trials]]\n\
    map = [\"gbs\", \"gbs+f-km\"]\nsize = [10, 20]\ndraws = 2\n[[views.tests]]\ny = \"log_likelihood\"\n\
    test = \"welch\"\npairs = [[\"gbs+f-km\", \"gbs\"]]\n[[views.charts]]\nname = \"chart\"\n\
    x = { column = \"real_percent\", scale = \"log\" }\ny = { column = \"log_likelihood\" }\n";
const LOCALIZATION: &str = "seed = 1\n[base]\ntolerance = 1e-2\nparticles = 10\nbeams = 5\n[[trials]]\n\
    map = [\"gbs\", \"gbs+f-km\", \"rnd\"]\nsize = 20\ndraws = 2\nruns = 1\n[[views.tests]]\ny = \"weighted\"\n\
    ratio = true\npairs = [[\"gbs+f-km\", \"gbs\"]]\n[views.ranking]\ny = \"weighted\"\n";
