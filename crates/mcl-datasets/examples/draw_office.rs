//! Draws the simulated office as an SVG on stdout: `cargo run --example draw_office > office.svg`.
//! Walls are black, glass is blue, the robot's path red, and the measured points grey.

use std::fmt::Write as _;

use mcl_core::Seed;
use mcl_datasets::simulator::{Material, Office, OfficeSettings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let office = Office::new(&OfficeSettings::default(), Seed::new(1))?;
    let recording = office.record();
    let mut svg = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='-1 -31 32 32' width='1600' height='1600'>\n\
         <rect x='-1' y='-31' width='32' height='32' fill='white'/>\n\
         <g transform='scale(1 -1)' fill='none' stroke-width='0.02'>\n",
    );
    for [x, y] in recording.points(10.0)? {
        writeln!(svg, "<circle cx='{x:.3}' cy='{y:.3}' r='0.02' fill='#999'/>")?;
    }
    for segment in office.obstacles().segments() {
        let ([x1, y1], [x2, y2]) = (segment.from, segment.to);
        let color = if segment.material == Material::Glass { "dodgerblue" } else { "black" };
        writeln!(svg, "<path d='M{x1:.3} {y1:.3}L{x2:.3} {y2:.3}' stroke='{color}'/>")?;
    }
    for circle in office.obstacles().circles() {
        let ([x, y], r) = (circle.center, circle.radius);
        writeln!(svg, "<circle cx='{x:.3}' cy='{y:.3}' r='{r:.3}' stroke='black'/>")?;
    }
    let path: Vec<String> = office.path().iter().map(|[x, y]| format!("{x:.3},{y:.3}")).collect();
    writeln!(svg, "<polyline points='{}' stroke='red'/>", path.join(" "))?;
    for pose in recording.reference()? {
        writeln!(svg, "<circle cx='{:.3}' cy='{:.3}' r='0.05' fill='red'/>", pose.x, pose.y)?;
    }
    svg.push_str("</g></svg>\n");
    print!("{svg}");
    Ok(())
}
