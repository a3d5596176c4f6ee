//! How a picture is cut for the net.

/// A part of a picture, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tile {
    pub x: usize,
    pub y: usize,
    pub width: usize,
    pub height: usize,
}

impl Tile {
    /// Whether a box (left, top, right, bottom from the picture's corner) reaches a border of the tile inside the
    /// picture: it is probably cut there, and another tile or a coarser pass has it whole.
    pub fn cuts(&self, [left, top, right, bottom]: [f64; 4], picture: (usize, usize)) -> bool {
        // Cut boxes end somewhere near the border, not on it.
        const NEAR_PX: f64 = 4.0;
        let (x1, y1) = (self.x + self.width, self.y + self.height);
        (self.x > 0 && left < self.x as f64 + NEAR_PX)
            || (self.y > 0 && top < self.y as f64 + NEAR_PX)
            || (x1 < picture.0 && right > x1 as f64 - NEAR_PX)
            || (y1 < picture.1 && bottom > y1 as f64 - NEAR_PX)
    }
}

/// Tiles of equal size that cover a picture with at least the given overlap.
pub(crate) fn tiles(width: usize, height: usize, longest: usize, overlap: usize) -> Vec<Tile> {
    let mut all = Vec::new();
    let (columns, tile_width) = spans(width, longest, overlap);
    let (rows, tile_height) = spans(height, longest, overlap);
    for &y in &rows {
        for &x in &columns {
            all.push(Tile { x, y, width: tile_width, height: tile_height });
        }
    }
    all
}

/// Starts and common length of the spans along one axis.
fn spans(length: usize, longest: usize, overlap: usize) -> (Vec<usize>, usize) {
    if length <= longest {
        return (vec![0], length);
    }
    let count = (length - overlap).div_ceil(longest - overlap);
    let span = (length + (count - 1) * overlap).div_ceil(count);
    let last = length - span;
    ((0..count).map(|i| last * i / (count - 1)).collect(), span)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_and_overlap() {
        for length in [100, 416, 417, 800, 1920, 3840, 4096] {
            let (starts, span) = spans(length, 416, 96);
            assert!(span <= 416 && starts[0] == 0 && starts[starts.len() - 1] + span == length, "{length}");
            assert!(starts.windows(2).all(|pair| pair[0] + span >= pair[1] + 96 - 1), "{length}: {starts:?}");
        }
        assert_eq!(tiles(1920, 1080, 1920, 192), [Tile { x: 0, y: 0, width: 1920, height: 1080 }]);
        assert_eq!(tiles(3840, 2160, 1920, 192).len(), 6);
    }

    #[test]
    fn boxes_at_inner_borders_are_cut() {
        let tile = Tile { x: 100, y: 0, width: 100, height: 100 };
        assert!(tile.cuts([101.0, 20.0, 140.0, 50.0], (200, 100)));
        assert!(!tile.cuts([120.0, 0.0, 199.5, 99.5], (200, 100)), "the picture's own borders");
        assert!(tile.cuts([120.0, 10.0, 199.5, 50.0], (300, 100)));
    }
}
