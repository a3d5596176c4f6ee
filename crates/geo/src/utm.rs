//! Conversion between longitude and latitude (WGS 84) and the metres of a UTM zone.

use proj4rs::Proj;
use proj4rs::transform::transform;

/// A UTM zone. Its coordinates are also valid for positions outside but near the zone, so the zone's edge needs no
/// special case.
#[derive(Clone, Debug)]
pub struct UtmZone {
    number: i32,
    south: bool,
    metres: Proj,
    degrees: Proj,
}

impl UtmZone {
    /// Returns the zone of a position, which is given in degrees (WGS 84).
    ///
    /// The special, wider zones of Norway and Svalbard are not used. They are not needed, because each zone is valid
    /// beyond its edge.
    ///
    /// # Errors
    /// Returns a message if UTM does not cover the position.
    pub fn around(latitude: f64, longitude: f64) -> Result<Self, String> {
        if !(latitude.abs() <= 84.0 && longitude.abs() <= 180.0) {
            return Err(format!(
                "latitude {latitude}, longitude {longitude} is not a position that UTM covers"
            ));
        }
        let number = ((longitude + 180.0) / 6.0).floor() as i32 % 60 + 1;
        Self::numbered(number, latitude < 0.0)
    }

    /// Returns the zone with this number, 1–60, in the southern or northern hemisphere.
    ///
    /// # Errors
    /// Returns a message if there is no such zone.
    pub fn numbered(number: i32, south: bool) -> Result<Self, String> {
        let half = if south { " +south" } else { "" };
        let of = |text: &str| Proj::from_proj_string(text).map_err(|e| format!("UTM zone {number}: {e}"));
        Ok(Self {
            number,
            south,
            metres: of(&format!("+proj=utm +zone={number}{half} +datum=WGS84 +units=m +no_defs"))?,
            degrees: of("+proj=longlat +datum=WGS84 +no_defs")?,
        })
    }

    /// Returns the name of the zone, such as `33N`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}{}", self.number, if self.south { 'S' } else { 'N' })
    }

    /// Returns the easting and northing of a position, m.
    ///
    /// # Errors
    /// Returns a message if the position is too far from the zone.
    pub fn from_degrees(&self, latitude: f64, longitude: f64) -> Result<[f64; 2], String> {
        let mut point = (longitude.to_radians(), latitude.to_radians(), 0.0);
        transform(&self.degrees, &self.metres, &mut point).map_err(|e| e.to_string())?;
        Ok([point.0, point.1])
    }

    /// Returns the latitude and longitude of a position, degrees.
    ///
    /// # Errors
    /// Returns a message if the position is too far from the zone.
    pub fn to_degrees(&self, [east, north]: [f64; 2]) -> Result<[f64; 2], String> {
        let mut point = (east, north, 0.0);
        transform(&self.metres, &self.degrees, &mut point).map_err(|e| e.to_string())?;
        Ok([point.1.to_degrees(), point.0.to_degrees()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_coordinates_come_out() {
        // A point on a central meridian at the equator (Snyder 1987, p. 63).
        let zone = UtmZone::around(0.0, 9.0).unwrap();
        assert_eq!(zone.name(), "32N");
        let [east, north] = zone.from_degrees(0.0, 9.0).unwrap();
        assert!((east - 500_000.0).abs() < 1e-6 && north.abs() < 1e-6);
        // The published position of the CN Tower: 17 T 630084 m east, 4833438 m north.
        let zone = UtmZone::around(43.642_567, -79.387_139).unwrap();
        let [east, north] = zone.from_degrees(43.642_567, -79.387_139).unwrap();
        assert_eq!(zone.name(), "17N");
        assert!((east - 630_084.0).abs() < 1.0 && (north - 4_833_438.0).abs() < 1.5, "{east} {north}");
        assert_eq!(UtmZone::around(-33.9, 151.2).unwrap().name(), "56S");
        assert!(UtmZone::around(91.0, 0.0).is_err());
    }

    #[test]
    fn conversion_there_and_back_works_across_the_edge_of_a_zone() {
        let zone = UtmZone::numbered(32, false).unwrap();
        for (latitude, longitude) in [(51.05, 13.9), (48.1, 11.6), (59.9, 5.9)] {
            let metres = zone.from_degrees(latitude, longitude).unwrap();
            let back = zone.to_degrees(metres).unwrap();
            assert!((back[0] - latitude).abs() < 1e-9 && (back[1] - longitude).abs() < 1e-9);
        }
    }
}
