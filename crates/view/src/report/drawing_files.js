"use strict";
// The files of the drawing part: gates and zones (GeoJSON), lengths (CSV of `--known`), surveyed points (CSV of `--geo`).
// A drawing is { kind, points, name, ... }: `kind` is gate, zone, length or point, and `points` are pixels of the frame.

const drawingFiles = (size) => {
  const HUNDREDTHS = 100; // files have pixels to a hundredth
  const LEAST = { gate: 2, zone: 3, length: 2, point: 1 };
  const SD_SHARE = 0.02; // sd of a length without an sd, as a share of the length
  const rounded = ([x, y]) => [x, y].map((v) => Math.round(v * HUNDREDTHS) / HUNDREDTHS);
  const number = (text) => {
    const plain = String(text ?? "").trim().replace(",", ".");
    return plain !== "" && Number.isFinite(Number(plain)) ? Number(plain) : null;
  };
  const crosses = ([a, b], [c, d]) => {
    const side = (p, q, r) => Math.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
    return side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
  };
  const edgesOf = (points) => points.map((point, i) => [point, points[(i + 1) % points.length]]);

  // Returns the first fault of each drawing as [drawing, words].
  const faults = (drawings) => {
    const names = new Map();
    const fault = (drawing) => {
      const { kind, points, name } = drawing;
      if (kind === "gate" || kind === "zone") {
        if (!name.trim()) return `A ${kind} needs a name.`;
        if (names.has(name.trim())) return `Two drawings have the name “${name.trim()}”: change one of them.`;
        names.set(name.trim(), drawing);
        const edges = edgesOf(points);
        if (kind === "zone" && edges.some((one, i) => edges.slice(i + 1).some((other) => crosses(one, other)))) return `The edges of “${name.trim()}” cross each other: move a point.`;
        if (points.every(([x, y]) => Math.hypot(x - points[0][0], y - points[0][1]) < 1)) return `All points of “${name.trim()}” are at one pixel.`;
        return null;
      }
      if (kind === "length") {
        const [metres, sd] = [number(drawing.metres), number(drawing.sd)];
        if (Math.hypot(points[0][0] - points[1][0], points[0][1] - points[1][1]) < 1) return `Both ends of ${name} are at one pixel.`;
        if (metres === null || metres <= 0) return `${name}: enter the length in metres, above 0.`;
        if (drawing.sd.trim() && (sd === null || sd <= 0 || sd >= metres)) return `${name}: the sd must be above 0 and below the length.`;
        return null;
      }
      const [latitude, longitude] = [number(drawing.latitude), number(drawing.longitude)];
      if (latitude === null || Math.abs(latitude) > 90) return `${name}: enter the latitude, from −90 to 90.`;
      if (longitude === null || Math.abs(longitude) > 180) return `${name}: enter the longitude, from −180 to 180.`;
      if (drawing.height.trim() && number(drawing.height) === null) return `${name}: the height must be a number, or empty.`;
      return null;
    };
    const found = drawings.map((drawing) => [drawing, fault(drawing)]).filter(([, words]) => words);
    if (drawings[0]?.kind === "point" && drawings.length < 3) found.push([null, `The program needs three or more points; there ${drawings.length > 1 ? "are two" : "is one"}.`]);
    return found;
  };

  const geojson = (drawings, { frame, segment }) => {
    const feature = ({ kind, points, name, properties }) => {
      const line = points.map(rounded);
      const geometry = kind === "zone" ? { type: "Polygon", coordinates: [[...line, line[0]]] } : { type: "LineString", coordinates: line };
      return JSON.stringify({ type: "Feature", properties: { ...properties, name: name.trim() }, geometry });
    };
    const members = { type: "FeatureCollection", coordinates: "pixels", image_size_px: size, frame, ...(segment === null ? {} : { segment }) };
    return `${JSON.stringify(members).slice(0, -1)},"features":[\n${drawings.map(feature).join(",\n")}\n]}\n`;
  };

  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const table = (columns, rows) => `${[columns, ...rows].map((row) => row.map((field) => quoted(String(field))).join(",")).join("\n")}\n`;
  // `moving` says whether the pixels belong to one frame only. The tables then name the frame.
  const lengths = (drawings, moving) => table(
    ["x1", "y1", "x2", "y2", "length_m", "sd_m", "pixel_sd", ...(moving ? ["frame"] : []), "name"],
    drawings.map(({ points, metres, sd, pixelSd, frame, name }) => [
      ...points.flatMap(rounded), number(metres), number(sd) ?? Number((SD_SHARE * number(metres)).toPrecision(3)), pixelSd, ...(moving ? [frame] : []), name.trim(),
    ]));
  const survey = (drawings, moving) => table(
    ["x_px", "y_px", "latitude", "longitude", "height_m", ...(moving ? ["frame"] : [])],
    drawings.map(({ points, latitude, longitude, height, frame }) => [
      ...rounded(points[0]), number(latitude), number(longitude), number(height) ?? 0, ...(moving ? [frame] : []),
    ]));

  // Reads a file of gates and zones. Pixels of a picture in another size are scaled.
  const gatesOf = (text) => {
    let file;
    try { file = JSON.parse(text); } catch { throw new Error("The file is not JSON."); }
    if (file?.type !== "FeatureCollection" || !Array.isArray(file.features)) throw new Error("The file is no GeoJSON FeatureCollection.");
    const unit = file.coordinates ?? "wgs84";
    if (unit !== "pixels") throw new Error(`The coordinates of the file are ${unit}. Only files in pixels can be drawn here.`);
    const [width, height] = file.image_size_px ?? size, scale = size[0] / width;
    if (!(Math.abs(size[1] / height / scale - 1) <= 0.01)) throw new Error(`The file belongs to a picture of ${width} × ${height} px. This one has ${size.join(" × ")} px.`);
    // The centre of the first pixel is (0, 0), so half a pixel is added before scaling.
    const pixel = (point) => point.slice(0, 2).map((v) => (v + 0.5) * scale - 0.5);
    const drawings = file.features.map((feature, i) => {
      const { type, coordinates } = feature?.geometry ?? {}, { name, ...properties } = feature?.properties ?? {};
      const kind = { LineString: "gate", Polygon: "zone" }[type];
      if (!kind) throw new Error(`Feature ${i + 1} is a ${type ?? "feature without a geometry"}. Only LineString and Polygon can be drawn.`);
      if (kind === "zone" && coordinates?.length !== 1) throw new Error(`Feature ${i + 1} is a Polygon with holes. Only its outline can be drawn.`);
      let line = kind === "zone" ? coordinates[0] : coordinates;
      if (!Array.isArray(line) || !line.every((point) => Array.isArray(point) && point.slice(0, 2).filter(Number.isFinite).length === 2)) throw new Error(`Feature ${i + 1} has coordinates that are no numbers.`);
      const [first, last] = [line[0], line.at(-1)];
      if (kind === "zone" && line.length > 1 && first[0] === last[0] && first[1] === last[1]) line = line.slice(0, -1);
      if (line.length < LEAST[kind]) throw new Error(`Feature ${i + 1} has too few points.`);
      return { kind, points: line.map(pixel), name: String(name ?? `${kind} ${i + 1}`), properties };
    });
    return { drawings, frame: Number.isInteger(file.frame) ? file.frame : 0 };
  };

  // Reads a table of lengths or of surveyed points, which the columns tell apart.
  const tableOf = (text) => {
    const fields = (line) => {
      const found = [""];
      let quoted = false;
      for (let i = 0; i < line.length; i++) {
        if (line[i] === '"' && quoted && line[i + 1] === '"') found[found.length - 1] += line[i++];
        else if (line[i] === '"') quoted = !quoted;
        else if (line[i] === "," && !quoted) found.push("");
        else found[found.length - 1] += line[i];
      }
      return found.map((field) => field.trim());
    };
    const lines = text.split(/\r?\n/).filter((line) => line.trim() && !line.startsWith("#"));
    const columns = fields(lines[0] ?? "");
    const isLength = columns.includes("length_m");
    if (!isLength && !columns.includes("latitude")) throw new Error("The first line of a table must name its columns, such as x1,y1,x2,y2,length_m,sd_m or x_px,y_px,latitude,longitude.");
    return lines.slice(1).map((line, i) => {
      const values = fields(line), value = (name) => values[columns.indexOf(name)] ?? "";
      const pixels = (isLength ? ["x1", "y1", "x2", "y2"] : ["x_px", "y_px"]).map((name) => number(value(name)));
      if (pixels.includes(null)) throw new Error(`Row ${i + 1} of the table has pixels that are no numbers.`);
      const frame = number(value("frame"));
      const name = value("name") || `${isLength ? "length" : "point"} ${i + 1}`;
      return isLength
        ? { kind: "length", points: [pixels.slice(0, 2), pixels.slice(2)], name, frame, metres: value("length_m"), sd: value("sd_m"), pixelSd: number(value("pixel_sd")) ?? 1 }
        : { kind: "point", points: [pixels], name, frame, latitude: value("latitude"), longitude: value("longitude"), height: value("height_m") };
    });
  };

  return { LEAST, SD_SHARE, number, faults, geojson, lengths, survey, gatesOf, tableOf };
};
