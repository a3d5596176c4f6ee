//! Plots as SVG text. The text is deterministic and uses no external fonts or scripts.

use crate::html::escape;

/// Width and height of a plot, px.
const SIZE: (f64, f64) = (520.0, 340.0);
/// Margins around the axes, px: left, top, right, bottom.
const ROOM: (f64, f64, f64, f64) = (58.0, 34.0, 16.0, 46.0);
/// Colours that colour-blind readers can distinguish (Okabe & Ito 2008).
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333"];
/// Approximate number of tick marks per axis.
const MARKS: f64 = 6.0;
/// Height of one line of the legend, px.
const LINE: f64 = 17.0;

/// A plot of one or more series.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Title of the plot.
    pub title: String,
    /// Label of the x axis, with the unit.
    pub x_label: String,
    /// Label of the y axis, with the unit.
    pub y_label: String,
    /// Series, in the order in which they are drawn.
    pub series: Vec<Series>,
    /// Lowest and highest value on the y axis. If `None`, the axis includes 0 and all values.
    pub y_range: Option<[f64; 2]>,
}

/// A series of a plot: one curve or one cloud of points.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points (x, y), all finite.
    pub points: Vec<(f64, f64)>,
    /// Style in which the series is drawn.
    pub mark: Mark,
}

/// The style in which a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line with a dot at each point.
    Line,
    /// A line without dots.
    Curve,
    /// A thin dashed line, for reference values.
    Reference,
    /// A dot at each point.
    Dots,
}

impl Plot {
    /// Creates a plot without series. The range of the y axis is `None`.
    #[must_use]
    pub fn new(title: impl Into<String>, x_label: impl Into<String>, y_label: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            series: Vec::new(),
            y_range: None,
        }
    }

    /// Adds a series. Points with coordinates that are not finite are left out.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        let points = points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
        self.series.push(Series { name: name.into(), points, mark });
        self
    }

    /// Returns the plot as SVG text, or an empty string if there are no points.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let points = || self.series.iter().flat_map(|s| &s.points);
        if points().next().is_none() {
            return String::new();
        }
        let x_axis = Axis::around(points().map(|p| p.0), None);
        let y_axis = Axis::around(points().map(|p| p.1), self.y_range);
        let (width, height) = SIZE;
        let (left, top, right, bottom) = ROOM;
        // The legend is below the axes, so it does not cover the data.
        let columns = if self.series.iter().all(|s| s.name.chars().count() <= 28) { 2 } else { 1 };
        let whole = height + LINE * self.series.len().div_ceil(columns) as f64 + 6.0;
        let at = |(x, y): (f64, f64)| {
            (
                left + x_axis.share(x) * (width - left - right),
                height - bottom - y_axis.share(y) * (height - top - bottom),
            )
        };
        let mut svg = format!(
            "<svg class=\"plot\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {whole}\" width=\"{width}\" \
             height=\"{whole}\" role=\"img\" aria-label=\"{0}\" font-family=\"system-ui,sans-serif\" font-size=\"12\" fill=\"#1c2126\">\n\
             <rect width=\"{width}\" height=\"{whole}\" fill=\"#fff\"/>\n\
             <text x=\"{left}\" y=\"20\" font-size=\"14\" font-weight=\"600\">{0}</text>\n",
            escape(&self.title)
        );
        let (low_end, high_end) = (at((x_axis.low, y_axis.low)), at((x_axis.high, y_axis.high)));
        for mark in x_axis.marks() {
            let (x, _) = at((mark, y_axis.low));
            svg.push_str(&format!(
                "<path d=\"M{x:.1} {:.1}V{:.1}\" stroke=\"#e3e6e9\"/><text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n",
                low_end.1, high_end.1, low_end.1 + 16.0, x_axis.text(mark)
            ));
        }
        for mark in y_axis.marks() {
            let (_, y) = at((x_axis.low, mark));
            svg.push_str(&format!(
                "<path d=\"M{:.1} {y:.1}H{:.1}\" stroke=\"#e3e6e9\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
                low_end.0, high_end.0, low_end.0 - 6.0, y + 4.0, y_axis.text(mark)
            ));
        }
        let (middle_x, middle_y) = ((low_end.0 + high_end.0) / 2.0, (low_end.1 + high_end.1) / 2.0);
        svg.push_str(&format!(
            "<path d=\"M{:.1} {:.1}V{:.1}H{:.1}\" fill=\"none\" stroke=\"#66707a\"/>\n\
             <text x=\"{middle_x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate(14 {middle_y:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
            low_end.0,
            high_end.1,
            low_end.1,
            high_end.0,
            low_end.1 + 34.0,
            escape(&self.x_label),
            escape(&self.y_label)
        ));
        for (i, series) in self.series.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let placed: Vec<(f64, f64)> = series.points.iter().map(|p| at(*p)).collect();
            if series.mark != Mark::Dots {
                let line: Vec<String> = placed.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
                let style = if series.mark == Mark::Reference {
                    "stroke-dasharray=\"5 4\""
                } else {
                    "stroke-width=\"2\""
                };
                svg.push_str(&format!(
                    "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" {style}/>\n",
                    line.join(" ")
                ));
            }
            let (radius, opacity) = if series.mark == Mark::Dots { (2.0, 0.5) } else { (3.0, 1.0) };
            if matches!(series.mark, Mark::Line | Mark::Dots) {
                for (x, y) in placed {
                    svg.push_str(&format!(
                        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>"
                    ));
                }
                svg.push('\n');
            }
            let x = left + (i % columns) as f64 * (width - left) / columns as f64;
            let y = height + LINE * (i / columns) as f64;
            svg.push_str(&format!(
                "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"14\" height=\"4\" fill=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>\n",
                y - 2.0, x + 20.0, y + 4.0, escape(&series.name)
            ));
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// An axis from `low` to `high` with a tick mark every `step`.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    fn around(values: impl Iterator<Item = f64> + Clone, range: Option<[f64; 2]>) -> Self {
        let found = [values.clone().fold(0.0, f64::min), values.fold(f64::NEG_INFINITY, f64::max)];
        let [low, high] = range.unwrap_or(found);
        let high = if high > low { high } else { low + 1.0 };
        // The step is 1, 2 or 5 times a power of ten, chosen to give about MARKS tick marks.
        let rough = (high - low) / MARKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|s| *s >= rough * 0.999);
        let step = step.unwrap_or(rough);
        let whole = |value: f64, up: bool| {
            let steps = value / step;
            step * if up { (steps - 1e-9).ceil() } else { (steps + 1e-9).floor() }
        };
        if range.is_some() {
            Self { low, high, step }
        } else {
            Self { low: whole(low, false), high: whole(high, true), step }
        }
    }

    fn share(&self, value: f64) -> f64 {
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    fn marks(&self) -> Vec<f64> {
        let first = (self.low / self.step - 1e-9).ceil();
        let count = ((self.high - first * self.step) / self.step + 1e-9).floor() as usize + 1;
        (0..count).map(|i| (first + i as f64) * self.step).collect()
    }

    fn text(&self, mark: f64) -> String {
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        format!("{:.decimals$}", if mark.abs() < self.step * 1e-6 { 0.0 } else { mark })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_numbers() {
        let axis = Axis::around([0.0, 0.42].into_iter(), None);
        let texts: Vec<String> = axis.marks().iter().map(|m| axis.text(*m)).collect();
        assert_eq!(texts, ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5"]);
        let axis = Axis::around([3.0, 97.0].into_iter(), Some([0.0, 100.0]));
        let texts: Vec<String> = axis.marks().iter().map(|m| axis.text(*m)).collect();
        assert_eq!(texts, ["0", "20", "40", "60", "80", "100"]);
        let negative = Axis::around([-12.0, 31.0].into_iter(), None);
        assert_eq!(negative.marks().first().map(|m| negative.text(*m)), Some("-20".to_owned()));
        assert!((negative.share(-20.0)).abs() < 1e-12);
    }

    #[test]
    fn points_agree_with_the_axes() {
        let plot = Plot { y_range: Some([0.0, 100.0]), ..Plot::new("a < b", "x", "y") };
        let svg = plot.with("one", Mark::Line, vec![(0.0, 0.0), (1.0, 100.0), (f64::INFINITY, 3.0)]).to_svg();
        // The first point is the bottom left corner of the axes, and the second is the top right corner.
        assert!(svg.contains("points=\"58.0,294.0 504.0,34.0\""), "{svg}");
        assert!(svg.contains("a &lt; b") && svg.ends_with("</svg>\n"));
        assert_eq!(Plot::new("none", "x", "y").to_svg(), "");
    }
}
