//! The transformation from the ground to a plan from above.

/// The transformation from world coordinates (m) to coordinates in a drawing (px).
pub(crate) struct Sheet {
    /// Left, right, bottom and top edges of the plan in world coordinates, m.
    pub(crate) edges_m: [f64; 4],
    pub(crate) px_per_m: f64,
    /// Whether the viewing direction of the camera points to the right. Otherwise it points up.
    pub(crate) turned: bool,
}

impl Sheet {
    /// Creates the sheet on which a plan with these edges (left, right, bottom, top, m) is as large as `most_px` (width
    /// and height, px) permits.
    pub(crate) fn fitted(edges_m: [f64; 4], turned: bool, most_px: [f64; 2]) -> Self {
        let [left, right, bottom, top] = edges_m;
        let (wide_m, high_m) = (right - left, top - bottom);
        let [along_m, across_m] = if turned { [high_m, wide_m] } else { [wide_m, high_m] };
        let px_per_m = (most_px[0] / along_m).min(most_px[1] / across_m);
        Self { edges_m, px_per_m, turned }
    }

    /// Returns the place of a ground position in the drawing, px.
    pub(crate) fn at(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let [left, _, bottom, top] = self.edges_m;
        let right_and_down_m = if self.turned { [y_m - bottom, x_m - left] } else { [x_m - left, top - y_m] };
        let [x, y] = right_and_down_m.map(|m| m * self.px_per_m);
        (x, y)
    }

    /// Returns the width and height of the plan, px.
    pub(crate) fn size_px(&self) -> (f64, f64) {
        let [_, right, bottom, top] = self.edges_m;
        if self.turned { self.at(right, top) } else { self.at(right, bottom) }
    }
}
