"""Checks of exports for maps: GeoJSON, GeoParquet and KML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pandas as pd
import pyogrio
import pyproj
import shapely
from geojson_pydantic import FeatureCollection
from rows import BOX, by_frame, by_track, close


def check_geojson(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with geojson-pydantic and GDAL; if the run is on the map, PROJ converts its degrees to the UTM zone."""
    path, rows = folder / f"{name}.rows.geojson", by_frame(run)
    on_map = "latitude" in rows
    places = rows[["longitude", "latitude"] if on_map else ["x_m", "y_m"]]
    points = FeatureCollection.model_validate_json(path.read_text())
    close([p.geometry.coordinates[:2] for p in points.features], places, 1e-9)
    meta, _, geometry, fields = pyogrio.raw.read(path)
    close(shapely.get_coordinates(shapely.from_wkb(geometry)), places, 1e-9)
    columns = dict(zip(meta["fields"], fields, strict=True))
    for column in ("frame", "track", "time_s", "heading_rad", "x_sd_m", "observed"):
        close(columns[column], rows[column], 1e-9)
    if on_map:
        zone = rows.utm_zone.iloc[0]
        utm = pyproj.CRS.from_dict({"proj": "utm", "zone": int(zone[:-1]), "south": zone[-1] == "S", "datum": "WGS84"})
        to_utm = pyproj.Transformer.from_crs("EPSG:4326", utm, always_xy=True)
        close(np.column_stack(to_utm.transform(rows.longitude, rows.latitude)), rows[["east_m", "north_m"]], 1e-3)
    lines = FeatureCollection.model_validate_json((folder / f"{name}.tracks.geojson").read_text())
    assert len(lines.features) == run.track.nunique()
    return len(points.features)


def check_geoparquet(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with geopandas: every column of the rows, the points, and the lines of the tracks."""
    rows, run = geopandas.read_parquet(folder / f"{name}.rows.parquet"), by_frame(run)
    on_map = "latitude" in run
    places = run[["longitude", "latitude"] if on_map else ["x_m", "y_m"]]
    boxes = pd.DataFrame(np.stack(rows.bbox_px.to_numpy()), columns=BOX)
    found = pd.concat([pd.DataFrame(rows.drop(columns=["geometry", "bbox_px"])), boxes], axis=1)
    assert set(found) == set(run)
    pd.testing.assert_frame_equal(found[list(run)], run, check_dtype=False, rtol=0, atol=1e-12)
    lines = geopandas.read_parquet(folder / f"{name}.tracks.parquet")
    for table in (rows, lines):
        assert table.crs == ("OGC:CRS84" if on_map else None), table.crs
    close(rows.geometry.get_coordinates(), places, 0)
    paths = dict(zip(lines.track, lines.geometry, strict=True))
    assert set(paths) == set(run.track)
    for track, of_track in run.groupby("track"):
        path = shapely.get_coordinates(paths[track])
        close(path[: len(of_track)], places.loc[of_track.index], 0)
        assert len(path) == max(len(of_track), 2)
    return len(rows)


def check_kml(folder: Path, name: str, run: pd.DataFrame) -> int:
    """Checks with GDAL's reader of KML, and the times with the standard library."""
    path, run = folder / f"{name}.kml", by_track(run)
    lines = geopandas.read_file(path, engine="pyogrio")
    assert lines.crs == "EPSG:4326", lines.crs
    close(shapely.get_coordinates(lines.geometry.to_numpy()), run[["longitude", "latitude"]], 1e-9)
    assert lines.Name.tolist() == [f"{kind} {track}" for track, kind in run.groupby("track")["class"].first().items()]
    document = ElementTree.parse(path)
    names = {"kml": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    times = pd.to_datetime([when.text for when in document.iterfind(".//gx:Track/kml:when", names)], format="ISO8601")
    start = times[run.frame.argmin()] - pd.Timedelta(run.time_s[run.frame.argmin()], "s")
    close((times - start).total_seconds(), run.time_s, 1e-6)
    speeds = document.iterfind(".//gx:SimpleArrayData[@name='speed_mps']/gx:value", names)
    close([float(speed.text) for speed in speeds], run.speed_mps, 0)
    return len(times)
