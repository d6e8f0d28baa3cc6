"use strict";
(function () {
  const source = document.getElementById("map-data");
  if (!source || typeof L === "undefined") return;
  const data = JSON.parse(source.textContent);
  const SIGMA = ["#2c7fb8", "#41ae9b", "#8fc447", "#e0b32c", "#d7553a"];
  const UNKNOWN = "#8a8f98";
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  // the plane's x is east and y is north, both in metres
  const at = (p) => L.latLng(p[1], p[0]);

  const map = L.map("map", {
    crs: L.CRS.Simple, preferCanvas: true, attributionControl: false,
    minZoom: -10, maxZoom: 7, zoomSnap: 0.25, zoomDelta: 0.75, wheelPxPerZoomLevel: 90,
  });
  L.control.scale({ imperial: false, maxWidth: 140 }).addTo(map);
  const grid = L.layerGroup().addTo(map);

  // a canvas can only be drawn on once the map has a view
  const bounds = L.latLngBounds([]);
  data.fixes.forEach((p) => bounds.extend(at(p)));
  data.signs.xy.forEach((p) => bounds.extend(at(p)));
  if (data.path) data.path.runs.forEach((run) => run.p.forEach((p) => bounds.extend(at(p))));
  const whole = () => map.fitBounds(bounds.isValid() ? bounds.pad(0.04) : [[-50, -50], [50, 50]], { animate: false, maxZoom: 3 });
  whole();

  // path, gaps of the receiver, fixes
  const fixes = L.layerGroup().addTo(map);
  for (const p of data.fixes) {
    L.circleMarker(at(p), { radius: 1.8, stroke: false, fillColor: css("--soft"), fillOpacity: 0.6, interactive: false }).addTo(fixes);
  }
  if (data.path) {
    for (const run of data.path.outages) {
      L.polyline(run.map(at), { color: css("--c3"), weight: 12, opacity: 0.35, interactive: false }).addTo(map);
    }
    for (const run of data.path.runs) {
      L.polyline(run.p.map(at), { color: colourOf(run.c), weight: 3.5, smoothFactor: 0.5, interactive: false }).addTo(map);
    }
  }
  function colourOf(c) {
    if (c < 0) return UNKNOWN;
    const n = data.path.labels.length;
    return SIGMA[n > 1 ? Math.round(c * (SIGMA.length - 1) / (n - 1)) : 0];
  }

  // signs: faces where they are known and few enough for the page, else dots
  const words = (name) => {
    const parts = name.split("--").filter((part) => !/^g\d+$/.test(part));
    return (parts.length > 1 ? parts.slice(1) : parts).join(" ").replace(/-/g, " ");
  };
  const faceOf = (name) => (Object.hasOwn(data.faces, name) ? data.faces[name] : null);
  const FACE = 24, FACE_CHOSEN = 38, MANY = 300;
  const column = {};
  data.fields.forEach((field, i) => { column[field.name] = i; });
  const signs = data.signs;
  const markers = [];
  const arrows = L.layerGroup().addTo(map);
  signs.xy.forEach((p, i) => {
    const row = signs.rows[i];
    const colour = signs.colours[row[column["class"]]] || UNKNOWN;
    const [major, minor, azimuth] = signs.ellipse.map((values) => values[i]);
    if (major !== null && azimuth !== null) {
      L.polygon(ellipse(p, major, minor, azimuth), { color: colour, weight: 1, opacity: 0.7, fillOpacity: 0.08, smoothFactor: 0.3, interactive: false }).addTo(map);
    }
    const sure = row[column.status] === "ok";
    const face = signs.xy.length <= MANY ? faceOf(row[column["class"]]) : null;
    const marker = face ? L.marker(at(p), {
      icon: icon(face, FACE), opacity: sure ? 1 : 0.55, alt: words(row[column["class"]]),
      title: words(row[column["class"]]) + ", " + row[column.id], riseOnHover: true,
    }) : L.circleMarker(at(p), {
      radius: 6, color: sure ? css("--card") : colour, weight: sure ? 1.5 : 2,
      fillColor: colour, fillOpacity: sure ? 0.95 : 0.35,
    });
    marker.on("click", () => show(i, false));
    markers.push(marker.addTo(map));
  });
  function icon(url, size) {
    return L.icon({ iconUrl: url, iconSize: [size, size], className: "face" });
  }
  function mark(i, chosen) {
    const face = faceOf(signs.rows[i][column["class"]]);
    if (markers[i].setRadius) markers[i].setRadius(chosen ? 9 : 6);
    else markers[i].setIcon(icon(face, chosen ? FACE_CHOSEN : FACE)).setZIndexOffset(chosen ? 1000 : 0);
  }
  function ellipse(p, major, minor, azimuth) {
    const points = [], s = Math.sin(azimuth), c = Math.cos(azimuth);
    for (let k = 0; k < 40; k++) {
      const a = major * Math.cos(k * Math.PI / 20), b = minor * Math.sin(k * Math.PI / 20);
      points.push(at([p[0] + a * s - b * c, p[1] + a * c + b * s]));
    }
    return points;
  }
  // arrows keep their length on the screen
  function drawArrows() {
    arrows.clearLayers();
    const metre = 1 / map.options.crs.scale(map.getZoom());
    const view = map.getBounds().pad(0.1);
    signs.xy.forEach((p, i) => {
      const facing = signs.rows[i][column.facing_deg];
      if (facing === null || !view.contains(at(p))) return;
      const a = facing * Math.PI / 180;
      const reach = markers[i].setRadius ? 19 : 27;
      const tip = [p[0] + reach * metre * Math.sin(a), p[1] + reach * metre * Math.cos(a)];
      const side = (turn) => [tip[0] - 6 * metre * Math.sin(a + turn), tip[1] - 6 * metre * Math.cos(a + turn)];
      L.polyline([at(p), at(tip), at(side(0.5)), at(tip), at(side(-0.5))], {
        color: signs.colours[signs.rows[i][column["class"]]] || UNKNOWN, weight: 1.6, interactive: false,
      }).addTo(arrows);
    });
    markers.forEach((marker) => { if (marker.bringToFront) marker.bringToFront(); });
  }
  function drawGrid() {
    grid.clearLayers();
    const view = map.getBounds().pad(0.5);
    const metre = 1 / map.options.crs.scale(map.getZoom());
    const power = Math.pow(10, Math.floor(Math.log10(110 * metre)));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= 110 * metre * 0.999) || 10 * power;
    const style = { color: css("--map-grid"), weight: 1, interactive: false };
    const west = view.getWest(), east = view.getEast(), south = view.getSouth(), north = view.getNorth();
    for (let x = Math.ceil(west / step) * step; x <= east; x += step) L.polyline([[south, x], [north, x]], style).addTo(grid).bringToBack();
    for (let y = Math.ceil(south / step) * step; y <= north; y += step) L.polyline([[y, west], [y, east]], style).addTo(grid).bringToBack();
  }

  // the card of a sign; text of the recording is only ever set as text
  const element = (tag, text, parent) => {
    const e = document.createElement(tag);
    if (text !== undefined) e.textContent = text;
    if (parent) parent.appendChild(e);
    return e;
  };
  const table = document.querySelector("#sign-table tbody");
  function show(i, move) {
    const box = document.getElementById("sign");
    box.replaceChildren();
    const row = signs.rows[i];
    const face = faceOf(row[column["class"]]);
    if (face) {
      const picture = element("img", undefined, box);
      picture.src = face;
      picture.alt = "";
    }
    element("h3", words(row[column["class"]]) + ", " + row[column.id], box);
    const list = element("dl", undefined, box);
    const line = (name, value, title) => {
      const term = element("dt", name, list);
      if (title) term.title = title;
      element("dd", value, list);
    };
    line("longitude", signs.lonlat[i][0].toFixed(7) + "°");
    line("latitude", signs.lonlat[i][1].toFixed(7) + "°");
    if (signs.height_m[i] !== null) line("height", signs.height_m[i].toFixed(2) + " m", "height above the ellipsoid");
    data.fields.forEach((field, k) => {
      if (field.name === "id" || row[k] === null || row[k] === "") return;
      const value = Array.isArray(row[k]) ? row[k].join(", ") : String(row[k]);
      const unit = field.unit && field.unit !== "UTC" ? " " + field.unit : "";
      if (field.kind === "time") line(field.name.replace(/_/g, " "), value.replace("T", " ").replace("Z", " UTC"), field.meaning);
      else if (value) line(field.name.replace(/_(m|deg|m2)$/, "").replace(/_/g, " "), value + unit, field.meaning);
    });
    markers.forEach((_, k) => mark(k, k === i));
    if (table) Array.from(table.rows).forEach((r) => r.classList.toggle("on", r.cells[0].textContent === row[column.id]));
    if (move) map.setView(at(signs.xy[i]), Math.max(map.getZoom(), 2));
  }
  if (table) {
    const rowOf = new Map(signs.rows.map((row, i) => [row[column.id], i]));
    for (const r of table.rows) {
      const i = rowOf.get(r.cells[0].textContent);
      if (i === undefined) continue;
      r.classList.add("pick");
      r.addEventListener("click", () => { show(i, true); document.getElementById("map").scrollIntoView({ block: "nearest" }); });
    }
  }

  if (!signs.rows.length) document.getElementById("sign").remove();

  // legend
  const legend = document.getElementById("legend");
  const entry = (shape, colour, text, face) => {
    const line = element("div", undefined, legend);
    if (face) {
      const picture = element("img", undefined, line);
      picture.src = face;
      picture.alt = "";
      element("span", text, line);
      return;
    }
    const mark = element("span", undefined, line);
    mark.className = shape;
    mark.style.background = colour;
    element("span", text, line);
  };
  if (data.path) {
    element("h4", "Path, horizontal σ", legend);
    data.path.labels.forEach((label, c) => entry("swatch", colourOf(c), label));
    if (data.path.outages.length) entry("swatch", css("--c3"), "no GPS (broad line)");
  }
  if (data.fixes.length) entry("dot", css("--soft"), "GPS fix");
  if (signs.rows.length) {
    element("h4", "Signs (pale: with reservation)", legend);
    const counts = new Map();
    signs.rows.forEach((row) => counts.set(row[column["class"]], (counts.get(row[column["class"]]) || 0) + 1));
    const names = [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a));
    names.slice(0, 14).forEach((name) => entry("dot", signs.colours[name] || UNKNOWN, words(name) + " (" + counts.get(name) + ")", faceOf(name)));
    if (names.length > 14) element("div", "and " + (names.length - 14) + " more classes", legend);
  }

  // on paper the map is narrower
  const frame = map.getContainer();
  const refit = (width, height) => {
    frame.style.width = width;
    frame.style.height = height;
    map.invalidateSize({ animate: false });
    whole();
  };
  addEventListener("beforeprint", () => refit("480px", "380px"));
  addEventListener("afterprint", () => refit("", ""));

  drawGrid();
  drawArrows();
  map.on("moveend", () => { drawGrid(); drawArrows(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawGrid);
})();
