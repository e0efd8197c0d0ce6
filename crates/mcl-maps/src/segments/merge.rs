use super::SegmentSettings;
use super::piece::Piece;

/// Merges all pieces that are on one line, longest first.
///
/// The longest piece, whose line is known best, absorbs all pieces that [lie on it](Piece::goes_on_in) until there
/// are none; then the longest of the remaining ones does. This is repeated with the result until nothing changes.
pub(super) fn merge(mut pieces: Vec<Piece>, settings: &SegmentSettings) -> Vec<Piece> {
    loop {
        let before = pieces.len();
        pieces = merge_once(pieces, settings);
        if pieces.len() == before {
            pieces.sort_by(|a, b| b.by_length(a));
            return pieces;
        }
    }
}

fn merge_once(mut left: Vec<Piece>, settings: &SegmentSettings) -> Vec<Piece> {
    let SegmentSettings { tolerance, max_gap, .. } = *settings;
    left.sort_by(Piece::by_length);
    let mut merged = Vec::new();
    while let Some(mut piece) = left.pop() {
        loop {
            let parts: Vec<Piece> =
                left.extract_if(.., |other| piece.goes_on_in(other, tolerance, max_gap)).collect();
            if parts.is_empty() {
                break;
            }
            piece = piece.with(&parts);
        }
        merged.push(piece);
    }
    merged
}
