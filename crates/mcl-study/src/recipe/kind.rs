//! Kinds of maps by the names that studies, tables and figures use.

use std::fmt;

use mcl_maps::Refinement;
use serde::Serialize;

/// Who chooses the points of a sampled map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
pub enum Builder {
    /// Grid-based sampling.
    #[serde(rename = "gbs")]
    Grid,
    /// Random sampling.
    #[serde(rename = "rnd")]
    Random,
}

impl Builder {
    /// The paper's name.
    pub fn name(self) -> &'static str {
        match self {
            Builder::Grid => "gbs",
            Builder::Random => "rnd",
        }
    }
}

/// A kind of map.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapKind {
    /// Every point.
    All,
    /// Points chosen by a builder, possibly refined.
    Sampled {
        /// Who chose the points.
        builder: Builder,
        /// The refinement, if any.
        refinement: Option<Refinement>,
    },
    /// Occupancy grid with a likelihood field of one distance per cell.
    Occupancy,
    /// NDT map; `wide`: σ_hit² is added to each variance.
    Ndt {
        /// Whether σ_hit² is added.
        wide: bool,
    },
    /// Line segments.
    Segments,
}

/// A kind of map under its name in tables: "gbs", "gbs+f-km", "occupancy".
#[derive(Debug, Clone, PartialEq)]
pub struct NamedKind {
    /// The name.
    pub name: String,
    /// The kind.
    pub kind: MapKind,
}

/// Names of the refinements behind a `+`: fuzzy k-means goes by the paper's name.
pub fn refinement_names() -> impl Iterator<Item = (&'static str, Refinement)> {
    Refinement::ALL.into_iter().map(|method| match method {
        Refinement::Fkm {} => ("f-km", method),
        _ => (method.name(), method),
    })
}

impl NamedKind {
    /// Parses a kind by name. `named` are refinements defined by a study, which take precedence over built-in
    /// ones of the same name.
    ///
    /// # Errors
    /// A message with what was expected.
    pub fn parse(name: &str, named: &[(String, Refinement)]) -> Result<Self, String> {
        let kind = match name {
            "all" => MapKind::All,
            "occupancy" => MapKind::Occupancy,
            "ndt" => MapKind::Ndt { wide: false },
            "ndt+sigma" => MapKind::Ndt { wide: true },
            "segments" => MapKind::Segments,
            _ => {
                let (builder, refinement) = match name.split_once('+') {
                    Some((builder, refinement)) => (builder, Some(refinement)),
                    None => (name, None),
                };
                let builder = [Builder::Grid, Builder::Random]
                    .into_iter()
                    .find(|known| known.name() == builder)
                    .ok_or_else(|| {
                        format!(
                            "{name:?} is not a kind of map, expected all, gbs, rnd, gbs+REFINEMENT, \
                             rnd+REFINEMENT, occupancy, ndt, ndt+sigma or segments"
                        )
                    })?;
                let refinement = refinement.map(|wanted| {
                    let own = named.iter().find(|(name, _)| name == wanted).map(|found| found.1);
                    let built_in = || refinement_names().find(|(name, _)| *name == wanted);
                    own.or_else(|| Some(built_in()?.1)).ok_or_else(|| {
                        let known: Vec<&str> = refinement_names().map(|(name, _)| name).collect();
                        format!(
                            "{wanted:?} in {name:?} is not a refinement, expected {} or one of [refinement]",
                            known.join(", ")
                        )
                    })
                });
                MapKind::Sampled { builder, refinement: refinement.transpose()? }
            }
        };
        Ok(NamedKind { name: name.to_owned(), kind })
    }

    /// Who chose the points of a sampled map.
    pub fn builder(&self) -> Option<Builder> {
        match self.kind {
            MapKind::Sampled { builder, .. } => Some(builder),
            _ => None,
        }
    }

    /// Whether its size is an edge length (m) instead of a number of points.
    pub fn has_resolution(&self) -> bool {
        matches!(self.kind, MapKind::Occupancy | MapKind::Ndt { .. } | MapKind::Segments)
    }
}

impl fmt::Display for NamedKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read() {
        let sampled = |builder, refinement| MapKind::Sampled { builder, refinement };
        let own = [("restarts".to_owned(), Refinement::Restarts { restarts: 4 })];
        for (name, kind) in [
            ("gbs", sampled(Builder::Grid, None)),
            ("rnd+f-km", sampled(Builder::Random, Some(Refinement::Fkm {}))),
            ("gbs+best", sampled(Builder::Grid, Some(Refinement::BEST))),
            ("gbs+restarts", sampled(Builder::Grid, Some(own[0].1))),
            ("ndt+sigma", MapKind::Ndt { wide: true }),
        ] {
            assert_eq!(NamedKind::parse(name, &own).unwrap().kind, kind, "{name}");
        }
        for (name, expected) in [("grid", "not a kind of map"), ("gbs+fkm", "not a refinement")] {
            let message = NamedKind::parse(name, &own).unwrap_err();
            assert!(message.contains(expected) && message.contains(name), "{message}");
        }
    }
}
