//! Search for the poses at which a single scan is likely, for global localization and recovery.

use std::f64::consts::{PI, SQRT_2};

use mcl_core::memory::{reserve, with_room};
use mcl_core::{Bounds, OutOfMemory, Point, Pose2, Rng, math};
use rand::RngExt;

use crate::particles::Particles;
use crate::sensor::{FreeSpace, LikelihoodField, MapDistances, ScanEndpoints};

/// Number of beams that the search uses, evenly spread over the used beams of a scan.
const BEAMS: usize = 30;
/// Number of times a box of poses is halved along each axis.
const LEVELS: u32 = 2;
/// Largest number of initial boxes; on very large maps all boxes are larger instead.
const MOST_ROOTS: f64 = 1e6;
/// Half the side of a leaf is 0.7·σ_hit, within these limits (m).
const HALF: [f64; 2] = [0.1, 0.25];
/// Largest half width of a leaf in heading (rad).
const MOST_TURN: f64 = 0.1;
/// Leaves whose density is below e⁻⁶ of the largest are left out.
const CUT: f64 = 6.0;
/// Number of steps of the log-likelihood table of a beam, and its range in standard deviations.
const TABLE: usize = 4096;
const TABLE_END: f64 = 8.0;
/// Number of boxes whose distances are looked up together.
const BATCH: usize = 64;
/// What out-of-memory errors call this memory.
const BOXES: &str = "boxes of a search for the robot";

/// Log-likelihood of a beam by its distance from the map: the mixture of the likelihood field as a decreasing step
/// function, so that bounds are exact.
struct BeamTable {
    per_metre: f64,
    values: Vec<f64>,
}

impl BeamTable {
    /// Creates the table; `hit` and `random` are the two terms for a beam that ends on the map, with a Gaussian of
    /// this σ (m).
    fn new(hit: f64, random: f64, sigma: f64) -> Self {
        let per_metre = TABLE as f64 / (TABLE_END * sigma);
        let value = |step: usize| {
            let deviations = TABLE_END * step as f64 / TABLE as f64;
            math::ln(hit * math::exp(-0.5 * deviations * deviations) + random)
        };
        BeamTable { per_metre, values: (0..=TABLE).map(value).collect() }
    }

    /// The value at the step below a distance (m); that of distance 0 for negative distances.
    #[inline]
    fn at(&self, distance: f64) -> f64 {
        self.values[((distance * self.per_metre) as usize).min(TABLE)]
    }
}

/// A box of poses of the robot, identified by its position in the grid of its level.
#[derive(Debug, Clone, Copy)]
struct Node {
    place: [u32; 3],
    /// Log-likelihood at the centre.
    value: f64,
    /// No pose in the box has a larger one.
    bound: f64,
}

/// The grid of boxes of one level.
#[derive(Debug, Clone, Copy)]
struct Level {
    corner: Point<2>,
    /// Half the side of a box (m) and its half width in heading (rad).
    half: f64,
    turn: f64,
}

impl Level {
    fn centre(&self, place: [u32; 3]) -> Pose2 {
        let [x, y, theta] = place.map(|cell| 2.0 * f64::from(cell) + 1.0);
        Pose2 {
            x: self.corner[0] + x * self.half,
            y: self.corner[1] + y * self.half,
            theta: theta * self.turn - PI,
        }
    }

    fn next(&self) -> Self {
        Level { half: 0.5 * self.half, turn: 0.5 * self.turn, ..*self }
    }
}

/// A search for the poses that explain a scan: branch and bound over boxes of poses.
///
/// For any pose in a box with half widths h (m) and a (rad), the endpoint of a beam of length r is within
/// h·√2 + r·a of its position for the centre of the box, so its distance from the map is smaller by at most that.
/// The likelihood decreases with the distance, which gives an upper bound for all poses in the box.
/// Boxes whose bound is too far below the largest likelihood found are discarded, the others divided into eight.
///
/// The likelihood uses some of the beams and a Gaussian with the combined width of σ_hit and the leaves. Poses drawn
/// from the leaves are reweighted by the likelihood of the filter.
struct Search<'a> {
    distances: &'a MapDistances,
    table: BeamTable,
    beams: Vec<Point<2>>,
    /// The first level: boxes along x, y and the heading.
    boxes: [u32; 3],
    root: Level,
    free: Option<FreeBoxes>,
}

/// The boxes in free space, from the level of the leaves up to the first, each row by row. A leaf is in free space if
/// it contains the centre of a free cell, or its own centre is in one; so is every box that contains such a leaf.
struct FreeBoxes {
    levels: Vec<Vec<bool>>,
    /// Columns of the first level.
    columns: u32,
}

impl FreeBoxes {
    /// `None` if there is no such box.
    fn of(free: &FreeSpace, leaf: &Level, [columns, rows]: [u32; 2]) -> Option<Self> {
        let [across, along] = [columns, rows].map(|boxes| (boxes << LEVELS) as usize);
        let mut leaves: Vec<bool> = (0..across * along)
            .map(|number| {
                let Pose2 { x, y, .. } =
                    leaf.centre([(number % across) as u32, (number / across) as u32, 0]);
                free.holds([x, y])
            })
            .collect();
        for centre in free.centres() {
            let [column, row] =
                [0, 1].map(|axis| (centre[axis] - leaf.corner[axis]) / (2.0 * leaf.half));
            if column >= 0.0 && row >= 0.0 && column < across as f64 && row < along as f64 {
                leaves[row as usize * across + column as usize] = true;
            }
        }
        if !leaves.contains(&true) {
            return None;
        }
        let mut levels = vec![leaves];
        for level in 1..=LEVELS as usize {
            let width = across >> level;
            let mut boxes = vec![false; width * (along >> level)];
            let below = &levels[level - 1];
            for (number, _) in below.iter().enumerate().filter(|(_, is_free)| **is_free) {
                let (column, row) = (number % (2 * width), number / (2 * width));
                boxes[row / 2 * width + column / 2] = true;
            }
            levels.push(boxes);
        }
        Some(FreeBoxes { levels, columns })
    }

    /// Whether a box, `left` levels above the leaves, is in free space.
    fn hold(&self, left: u32, [column, row, _]: [u32; 3]) -> bool {
        let width = (self.columns << (LEVELS - left)) as usize;
        self.levels[left as usize][row as usize * width + column as usize]
    }
}

impl<'a> Search<'a> {
    /// Creates a search for a scan with endpoints, over positions within `window` or, without one, over all positions
    /// from which a beam can end on the map.
    fn new(
        field: &LikelihoodField<'a>,
        endpoints: &ScanEndpoints,
        window: Option<Bounds<2>>,
    ) -> Self {
        let distances = field.distances();
        let [hit, random, sigma] = field.parts();
        let number = endpoints.len().min(BEAMS);
        let chosen = |i: usize| (2 * i + 1) * endpoints.len() / (2 * number);
        let beams: Vec<Point<2>> =
            (0..number).map(chosen).map(|i| [endpoints.x()[i], endpoints.y()[i]]).collect();
        let squares: f64 = beams.iter().map(|[x, y]| x * x + y * y).sum();
        let lever = (squares / number as f64).sqrt();

        let window = window.unwrap_or_else(|| {
            let (Bounds { min, max }, reach) = (distances.bounds(), endpoints.reach());
            Bounds { min: min.map(|least| least - reach), max: max.map(|most| most + reach) }
        });
        let (corner, extent) = (window.min, [0, 1].map(|axis| window.extent(axis)));
        let parts = f64::from(1 << LEVELS);
        let headings = |half: f64| {
            let turn = (SQRT_2 * half / lever).min(MOST_TURN);
            (PI / (parts * turn)).ceil().min(1e4)
        };
        let columns =
            |half: f64| extent.map(|extent| (extent / (2.0 * parts * half)).ceil().max(1.0));
        let mut half = (0.7 * sigma).clamp(HALF[0], HALF[1]);
        while columns(half).into_iter().product::<f64>() * headings(half) > MOST_ROOTS {
            half *= 1.25;
        }
        let [across, along] = columns(half);
        let headings = headings(half);
        let turn = PI / (headings * parts);

        let boxes = [across, along, headings].map(|boxes| boxes as u32);
        let leaf = Level { corner, half, turn };
        let free = distances.free_space();
        let free = free.and_then(|free| FreeBoxes::of(free, &leaf, [boxes[0], boxes[1]]));

        // Variance of a position in a leaf: h²/3 along each axis, and r²a²/3 due to the heading.
        let widened = (sigma * sigma + (half * half + math::square(lever * turn)) / 3.0).sqrt();
        Search {
            distances,
            table: BeamTable::new(hit * sigma / widened, random, widened),
            beams,
            boxes,
            root: Level { corner, half: half * parts, turn: turn * parts },
            free,
        }
    }

    /// Whether the robot may be in a box, `left` levels above the leaves.
    fn may_hold(&self, left: u32, node: &Node) -> bool {
        self.free.as_ref().is_none_or(|free| free.hold(left, node.place))
    }

    /// Number of leaves in which the robot may be.
    fn number_of_leaves(&self) -> f64 {
        let [columns, rows, headings] = self.boxes.map(|boxes| f64::from(boxes << LEVELS));
        let places = match &self.free {
            Some(free) => free.levels[0].iter().filter(|is_free| **is_free).count() as f64,
            None => columns * rows,
        };
        places * headings
    }

    /// Computes the log-likelihoods and bounds of some boxes of a level.
    fn weigh(&self, level: &Level, nodes: &mut [Node], scratch: &mut Lookups) {
        let Lookups { points, distances, floors, ways } = scratch;
        ways.clear();
        ways.extend(
            self.beams.iter().map(|[x, y]| SQRT_2 * level.half + math::hypot(*x, *y) * level.turn),
        );
        for nodes in nodes.chunks_mut(BATCH) {
            points.clear();
            for node in &*nodes {
                let Pose2 { x, y, theta } = level.centre(node.place);
                let (sin, cos) = math::sin_cos(theta);
                points.extend(
                    self.beams
                        .iter()
                        .map(|[bx, by]| [x + cos * bx - sin * by, y + sin * bx + cos * by]),
                );
            }
            self.distances.with_floors(points, distances, floors);
            let number = self.beams.len();
            for ((node, distances), floors) in
                nodes.iter_mut().zip(distances.chunks(number)).zip(floors.chunks(number))
            {
                (node.value, node.bound) = (0.0, 0.0);
                for ((distance, floor), way) in distances.iter().zip(floors).zip(&*ways) {
                    node.value += self.table.at(*distance);
                    node.bound += self.table.at(floor - way);
                }
            }
        }
    }

    /// The leaves whose log-likelihood is at most `below` less than the largest, with the largest.
    fn leaves(&self, below: f64) -> Result<(Level, Vec<Node>, f64), OutOfMemory> {
        let mut scratch = Lookups::default();
        let [columns, rows, headings] = self.boxes;
        let mut level = self.root;
        let number = columns as usize * rows as usize * headings as usize;
        let mut nodes = with_room(number, BOXES)?;
        for heading in 0..headings {
            for row in 0..rows {
                let places = (0..columns).map(|column| Node::at([column, row, heading]));
                nodes.extend(places.filter(|node| self.may_hold(LEVELS, node)));
            }
        }
        self.weigh(&level, &mut nodes, &mut scratch);
        let largest =
            |nodes: &[Node], least: f64| nodes.iter().map(|node| node.value).fold(least, f64::max);
        let mut best = largest(&nodes, f64::NEG_INFINITY);
        for left in (0..LEVELS).rev() {
            level = level.next();
            // Likely boxes first, because their likelihoods allow others to be discarded.
            nodes.sort_by(|a, b| b.bound.total_cmp(&a.bound));
            let mut kept: Vec<Node> = Vec::new();
            for parents in nodes.chunks(BATCH) {
                let likely = parents.iter().filter(|node| node.bound >= best - below);
                let mut children: Vec<Node> = likely
                    .flat_map(Node::children)
                    .filter(|child| self.may_hold(left, child))
                    .collect();
                self.weigh(&level, &mut children, &mut scratch);
                best = largest(&children, best);
                reserve(&mut kept, children.len(), BOXES)?;
                let score = |node: &Node| if left == 0 { node.value } else { node.bound };
                kept.extend(children.into_iter().filter(|node| score(node) >= best - below));
            }
            nodes = kept;
        }
        let best = largest(&nodes, f64::NEG_INFINITY);
        nodes.retain(|node| node.value >= best - below);
        Ok((level, nodes, best))
    }
}

impl Node {
    fn at(place: [u32; 3]) -> Self {
        Node { place, value: f64::NEG_INFINITY, bound: f64::INFINITY }
    }

    /// The eight boxes from halving along each axis.
    fn children(&self) -> impl Iterator<Item = Node> + use<> {
        let place = self.place;
        (0..8u32)
            .map(move |half| Node::at([0, 1, 2].map(|axis| 2 * place[axis] + (half >> axis & 1))))
    }
}

/// Buffers of [`Search::weigh`].
#[derive(Default)]
struct Lookups {
    points: Vec<Point<2>>,
    distances: Vec<f64>,
    floors: Vec<f64>,
    ways: Vec<f64>,
}

/// The poses at which a scan is likely: boxes of poses with the tempered likelihood at their centres.
pub(crate) struct LikelyPoses {
    level: Level,
    places: Vec<[u32; 3]>,
    /// Running totals of the densities, relative to that of the most likely box.
    totals: Vec<f64>,
    /// ln of the volume of a box (m²·rad).
    log_volume: f64,
    /// The number of boxes in the whole search space, or in its free space if known.
    boxes: f64,
}

impl LikelyPoses {
    /// Searches the poses at which a scan with endpoints is likely, within a window (m) or, without one, over the
    /// whole map; the likelihood of the scan is raised to the power of `exponent`.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub(crate) fn search(
        field: &LikelihoodField<'_>,
        endpoints: &ScanEndpoints,
        window: Option<Bounds<2>>,
        exponent: f64,
    ) -> Result<Self, OutOfMemory> {
        let search = Search::new(field, endpoints, window);
        // The beams that are used represent all.
        let exponent = exponent * endpoints.len() as f64 / search.beams.len() as f64;
        let (level, leaves, best) = search.leaves(CUT / exponent)?;
        let mut totals = with_room(leaves.len(), BOXES)?;
        let mut total = 0.0;
        for leaf in &leaves {
            total += math::exp(exponent * (leaf.value - best));
            totals.push(total);
        }
        let boxes = search.number_of_leaves();
        let mut places = with_room(leaves.len(), BOXES)?;
        places.extend(leaves.iter().map(|leaf| leaf.place));
        let log_volume = math::ln(8.0 * level.half * level.half * level.turn);
        Ok(LikelyPoses { level, places, totals, log_volume, boxes })
    }

    /// Appends poses drawn from the boxes in proportion to their densities, uniformly within each. Their log-weights
    /// are the logarithm of the prior density over the proposal density, over their number; the likelihood has yet to
    /// be multiplied in. `log_prior` returns the logarithm of the prior (1/m²·rad), given a pose and the logarithm of
    /// the uniform density over all searched poses.
    pub(crate) fn draw(
        &self,
        number: usize,
        log_prior: impl Fn(&Pose2, f64) -> f64,
        rng: &mut Rng,
        particles: &mut Particles,
    ) {
        let Some(sum) = self.totals.last() else { return };
        let uniform = -self.log_volume - math::ln(self.boxes);
        for i in 0..number {
            let position = (i as f64 + rng.random::<f64>()) / number as f64 * sum;
            let leaf =
                self.totals.partition_point(|&total| total <= position).min(self.totals.len() - 1);
            let density = self.totals[leaf] - if leaf > 0 { self.totals[leaf - 1] } else { 0.0 };
            let Pose2 { x, y, theta } = self.level.centre(self.places[leaf]);
            let [right, up, left]: [f64; 3] =
                std::array::from_fn(|_| 2.0 * rng.random::<f64>() - 1.0);
            let Level { half, turn, .. } = self.level;
            let pose = Pose2::new(x + half * right, y + half * up, theta + turn * left);
            let log_density = math::ln(density / sum) - self.log_volume;
            particles.push(pose);
            particles
                .log_weight
                .push(log_prior(&pose, uniform) - log_density - math::ln(number as f64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::ObstacleGrid;
    use crate::{Beams, FilterSettings, SigmaHit};
    use mcl_core::{LaserScan, PointMap, ScanGeometry, Seed};
    use proptest::prelude::*;

    const REACH: f64 = 12.0;

    fn field(distances: &MapDistances) -> LikelihoodField<'_> {
        let settings = FilterSettings {
            sigma_hit: SigmaHit::Metres(0.3),
            z_rand: 0.5,
            max_range: REACH,
            ..FilterSettings::default()
        };
        LikelihoodField::new(distances, &settings.check().unwrap()).unwrap()
    }

    /// A room of 6 m × 4 m without symmetry, with a pillar and a niche.
    fn room() -> Vec<Point<2>> {
        let along = |from: Point<2>, to: Point<2>| {
            (0..=20).map(move |i| [0, 1].map(|k| from[k] + (to[k] - from[k]) * f64::from(i) / 20.0))
        };
        let corners = [
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 4.0],
            [2.5, 4.0],
            [2.5, 5.0],
            [1.5, 5.0],
            [1.5, 4.0],
            [0.0, 4.0],
        ];
        let walls =
            (0..corners.len()).flat_map(|i| along(corners[i], corners[(i + 1) % corners.len()]));
        walls.chain(along([4.0, 1.0], [4.0, 1.5])).collect()
    }

    /// The scan of a 360° scanner at a pose: for each beam the nearest point within half a beam.
    fn scan(points: &[Point<2>], pose: Pose2) -> LaserScan {
        let beams = 72;
        let angle_step = 2.0 * PI / f64::from(beams);
        let ranges = (0..beams).map(|beam| {
            let direction = pose.theta - PI + f64::from(beam) * angle_step;
            let seen = points.iter().filter_map(|p| {
                let (dx, dy) = (p[0] - pose.x, p[1] - pose.y);
                let off = mcl_core::wrap_angle(dy.atan2(dx) - direction).abs();
                (off < 0.5 * angle_step).then(|| dx.hypot(dy))
            });
            seen.fold(f64::INFINITY, f64::min)
        });
        LaserScan {
            stamp: None,
            geometry: ScanGeometry { start_angle: -PI, angle_step, beams: beams as usize },
            ranges: ranges.collect(),
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        }
    }

    fn endpoints(scan: &LaserScan) -> ScanEndpoints {
        let mut endpoints = ScanEndpoints::default();
        endpoints.load(scan, &Pose2::IDENTITY, Beams::All, REACH).unwrap();
        endpoints
    }

    fn kinds(points: &[Point<2>], cut: f64) -> [MapDistances; 3] {
        let map = PointMap::new(points.to_vec()).unwrap();
        let resolution = 0.25;
        let map_from_grid = Pose2::new(-1.0, -2.0, 0.3);
        let mut occupied = vec![false; 40 * 40];
        for &point in points {
            let [column, row] =
                map_from_grid.inverse().transform_point(point).map(|place| place / resolution);
            if (0.0..40.0).contains(&column) && (0.0..40.0).contains(&row) {
                occupied[row as usize * 40 + column as usize] = true;
            }
        }
        let free = Vec::new();
        let grid = ObstacleGrid { width: 40, resolution, map_from_grid, occupied, free };
        [
            MapDistances::grid(&map, cut).unwrap(),
            MapDistances::reference(&map, cut).unwrap(),
            MapDistances::cells(&grid, cut).unwrap(),
        ]
    }

    proptest! {
        /// No pose in a box is more likely than the bound of the box, for any size and any kind of map with bounds.
        #[test]
        fn the_bound_is_a_bound(
            points in prop::collection::vec([0.0..6.0f64, 0.0..5.0f64], 1..40),
            cut in prop::sample::select(vec![0.5, 2.0]),
            ends in prop::collection::vec([-8.0..8.0f64, -8.0..8.0f64], 1..20),
            place in [0..60u32, 0..60u32, 0..40u32],
            half in 0.01..1.0f64,
            turn in 0.001..0.5f64,
            inside in prop::collection::vec([-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64], 30),
        ) {
            let points: Vec<Point<2>> = points.into_iter().chain([[3.0, 2.0]]).collect();
            for distances in &kinds(&points, cut) {
                let search = Search {
                    distances,
                    table: BeamTable::new(0.7, 0.05, 0.3),
                    beams: ends.clone(),
                    boxes: [1; 3],
                    root: Level { corner: [-3.0, -3.0], half, turn },
                    free: None,
                };
                let mut nodes = [Node::at(place)];
                search.weigh(&search.root, &mut nodes, &mut Lookups::default());
                let centre = search.root.centre(place);
                prop_assert!(nodes[0].value <= nodes[0].bound);
                for [x, y, theta] in inside.iter().copied() {
                    let pose = Pose2 {
                        x: centre.x + half * x,
                        y: centre.y + half * y,
                        theta: centre.theta + turn * theta,
                    };
                    let (sin, cos) = pose.theta.sin_cos();
                    let exact = ends.iter().map(|[bx, by]| {
                        let place = [pose.x + cos * bx - sin * by, pose.y + sin * bx + cos * by];
                        let mut squared = Vec::new();
                        distances.distances_squared(&[place], &mut squared);
                        search.table.at(squared[0].sqrt())
                    });
                    prop_assert!(exact.sum::<f64>() <= nodes[0].bound + 1e-9);
                }
            }
        }
    }

    /// Branch and bound keeps exactly the leaves that an evaluation of all leaves keeps.
    #[test]
    fn no_leaf_is_lost() {
        let points = room();
        let scan = endpoints(&scan(&points, Pose2::new(1.7, 1.2, 0.4)));
        for distances in &kinds(&points, 2.0) {
            let field = field(distances);
            let search = Search::new(&field, &scan, None);
            for below in [10.0, 40.0] {
                let (level, kept, best) = search.leaves(below).unwrap();
                let [columns, rows, headings] = search.boxes.map(|boxes| boxes << LEVELS);
                let mut all = Vec::new();
                for heading in 0..headings {
                    for row in 0..rows {
                        all.extend((0..columns).map(|column| Node::at([column, row, heading])));
                    }
                }
                search.weigh(&level, &mut all, &mut Lookups::default());
                let most = all.iter().map(|node| node.value).fold(f64::NEG_INFINITY, f64::max);
                assert_eq!(most, best);
                all.retain(|node| node.value >= best - below);
                let sorted = |nodes: &[Node]| {
                    let mut places: Vec<[u32; 3]> = nodes.iter().map(|node| node.place).collect();
                    places.sort_unstable();
                    places
                };
                assert!(all.len() > 1);
                assert_eq!(sorted(&kept), sorted(&all));
            }
        }
    }

    #[test]
    fn a_scan_is_found_where_it_was_taken() {
        let points = room();
        let map = PointMap::new(points.clone()).unwrap();
        let distances = MapDistances::grid(&map, 2.0).unwrap();
        let field = field(&distances);
        for pose in [Pose2::new(1.7, 1.2, 0.4), Pose2::new(5.0, 3.0, -2.5)] {
            let scan = endpoints(&scan(&points, pose));
            let places = LikelyPoses::search(&field, &scan, None, 1.0).unwrap();
            let mut particles = Particles::empty();
            places.draw(1000, |_, uniform| uniform, &mut Seed::new(1).rng(), &mut particles);
            let near = particles.iter().filter(|(found, _)| found.distance(&pose) < 0.5);
            assert!(near.count() > 900, "{pose:?}");
        }
    }

    /// A room that looks the same from both ends. If only one half is free, all draws are there, and the
    /// leaves are the free ones of the whole search.
    #[test]
    fn only_free_space_is_searched() {
        let points: Vec<Point<2>> = (0..=60)
            .flat_map(|i| [0.0, 4.0].map(|y| [0.1 * f64::from(i), y]))
            .chain((0..=40).flat_map(|i| [0.0, 6.0].map(|x| [x, 0.1 * f64::from(i)])))
            .collect();
        let map = PointMap::new(points.clone()).unwrap();
        let scan = endpoints(&scan(&points, Pose2::new(1.5, 1.0, 0.3)));
        let grid = ObstacleGrid {
            width: 60,
            resolution: 0.1,
            map_from_grid: Pose2::IDENTITY,
            occupied: vec![false; 60 * 40],
            free: (0..60 * 40).map(|cell| cell % 60 < 28).collect(),
        };
        let free = FreeSpace::of(&grid).unwrap().unwrap();
        let distances = MapDistances::grid(&map, 2.0).unwrap();
        let halved = MapDistances::grid(&map, 2.0).unwrap().with_free_space(Some(free.clone()));
        let drawn = |distances: &MapDistances| {
            let places = LikelyPoses::search(&field(distances), &scan, None, 1.0).unwrap();
            let mut particles = Particles::empty();
            places.draw(1_000, |_, uniform| uniform, &mut Seed::new(1).rng(), &mut particles);
            let other = Pose2::new(4.5, 3.0, 0.0);
            (places, particles.iter().filter(|(pose, _)| pose.distance(&other) < 1.0).count())
        };
        let (everywhere, in_both) = drawn(&distances);
        let (in_half, in_other) = drawn(&halved);
        assert!(in_both > 50 && in_other == 0, "{in_both} {in_other}");
        let field = field(&halved);
        let search = Search::new(&field, &scan, None);
        let holds = |place: &[u32; 3]| search.free.as_ref().unwrap().hold(0, *place);
        assert!(in_half.places.iter().all(holds));
        let of_both = everywhere.places.iter().filter(|place| holds(place));
        assert!(of_both.clone().count() > 0);
        assert!(of_both.into_iter().all(|place| in_half.places.contains(place)));
        // With fewer leaves in total, each is a larger part of them.
        let leaves = search.number_of_leaves();
        assert_eq!(in_half.boxes, leaves);
        let cells = free.centres().count() as f64 * 0.01;
        let side = 2.0 * in_half.level.half;
        let headings = f64::from(search.boxes[2] << LEVELS);
        let area = leaves / headings * side * side;
        assert!((cells..1.3 * cells).contains(&area), "{area} for {cells} m²");
    }

    /// The weights compensate for the proposal: the mean of L/q is ∫L over all poses, whatever the
    /// exponent of q, as long as it is small enough that no part of L is discarded.
    #[test]
    fn draws_are_weighted_by_their_density() {
        let points = room();
        let map = PointMap::new(points.clone()).unwrap();
        let distances = MapDistances::grid(&map, 2.0).unwrap();
        let field = field(&distances);
        let scan = endpoints(&scan(&points, Pose2::new(1.7, 1.2, 0.4)));
        let evidence = [0.5, 0.25, 0.125].map(|exponent| {
            let places = LikelyPoses::search(&field, &scan, None, exponent).unwrap();
            let mut particles = Particles::empty();
            places.draw(100_000, |_, uniform| uniform, &mut Seed::new(2).rng(), &mut particles);
            let terms: Vec<f64> = particles
                .iter()
                .map(|(pose, log)| log + field.log_likelihood(&scan, pose))
                .collect();
            let most = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            most + terms.iter().map(|term| (term - most).exp()).sum::<f64>().ln()
        });
        for other in &evidence[1..] {
            assert!((other - evidence[0]).abs() < 0.03, "{evidence:?}");
        }
    }
}
