"use strict";
(function () {
  const source = document.getElementById("map-data");
  if (!source || typeof L === "undefined") return;
  const data = JSON.parse(source.textContent);
  const { at, css, ellipse } = plane;
  const SIGMA = [0, 1, 2, 3, 4].map((k) => css(`--s${k}`));
  const UNKNOWN = css("--unknown");

  const map = plane.map("map", { maxZoom: 7 });
  const grid = L.layerGroup().addTo(map);
  let below = null;
  if (data.background) {
    const [west, south, east, north] = data.background.box;
    below = L.imageOverlay(data.background.src, [[south, west], [north, east]], { interactive: false, alt: data.background.text, className: "below" }).addTo(map);
  }

  // a canvas can only be drawn on once the map has a view
  const bounds = L.latLngBounds([]);
  data.fixes.forEach((p) => bounds.extend(at(p)));
  data.signs.xy.forEach((p) => bounds.extend(at(p)));
  if (data.path) data.path.points.forEach((p) => bounds.extend(at(p)));
  data.tracks.forEach((run) => run.forEach((p) => bounds.extend(at(p))));
  const whole = () => {
    map.fitBounds(bounds.isValid() ? bounds.pad(0.04) : [[-50, -50], [50, 50]], { animate: false, maxZoom: 3 });
    // drives on two continents: one of them, rather than the sea between
    if (bounds.isValid() && !map.getBounds().contains(bounds) && data.tracks.length) {
      map.fitBounds(L.latLngBounds(data.tracks[0].map(at)).pad(0.04), { animate: false, maxZoom: 3 });
    }
  };
  whole();

  // path, gaps of the receiver, fixes
  const fixes = L.layerGroup().addTo(map);
  for (const p of data.fixes) {
    L.circleMarker(at(p), { radius: 1.8, stroke: false, fillColor: css("--soft"), fillOpacity: 0.6, interactive: false }).addTo(fixes);
  }
  const track = L.layerGroup().addTo(map);
  // on a picture from the air lines have a rim
  const line = (points, style, to) => {
    const own = { smoothFactor: 0.5, interactive: false, ...style };
    if (below && map.hasLayer(below)) L.polyline(points, { ...own, color: css("--card"), weight: own.weight + 2.5, opacity: 0.85 }).addTo(to);
    L.polyline(points, own).addTo(to);
  };
  for (const run of data.tracks) line(run.map(at), { color: UNKNOWN, weight: 1.5, opacity: 0.7 }, map);
  if (data.path) {
    for (const run of data.path.outages) {
      L.polyline(run.map(at), { color: css("--c3"), weight: 12, opacity: 0.35, interactive: false }).addTo(map);
    }
    drawPath(data.path.modes[0]);
  }
  function drawPath(mode) {
    track.clearLayers();
    const points = data.path.points.map(at);
    const style = (c) => ({ color: mode ? colourOf(c, mode.labels.length) : UNKNOWN, weight: 3.5, smoothFactor: 0.5, interactive: false });
    if (!mode) { L.polyline(points, style(-1)).addTo(track); return; }
    let first = 0;
    for (const [c, count] of mode.runs) {
      // runs share a point, so that the line is in one piece
      const part = points.slice(first, first + count + 1);
      if (part.length > 1) L.polyline(part, style(c)).addTo(track);
      first += count;
    }
  }
  function colourOf(c, n) {
    if (c < 0) return UNKNOWN;
    return SIGMA[n > 1 ? Math.round(c * (SIGMA.length - 1) / (n - 1)) : 0];
  }

  // signs: faces where they are known and few enough for the page, else dots
  const words = (name) => (Object.hasOwn(data.words, name) ? data.words[name] : name);
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
    const sure = ["ok", "accepted", "corrected", "added"].includes(row[column.status]);
    const face = signs.xy.length <= MANY ? faceOf(row[column["class"]]) : null;
    const marker = face ? L.marker(at(p), {
      icon: icon(face, FACE), opacity: sure ? 1 : 0.55, alt: words(row[column["class"]]),
      title: words(row[column["class"]]) + ", " + row[column.id], riseOnHover: true,
      // by keyboard the list opens each: faces of one post lie over one another
      keyboard: false,
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
      const colour = signs.colours[signs.rows[i][column["class"]]] || UNKNOWN;
      line([at(p), at(tip), at(side(0.5)), at(tip), at(side(-0.5))], { color: colour, weight: 1.6 }, arrows);
    });
    markers.forEach((marker) => { if (marker.bringToFront) marker.bringToFront(); });
  }
  function drawGrid() {
    grid.clearLayers();
    if (below && data.background.opaque && map.hasLayer(below)) return;
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
    const own = signs.cards[i];
    if (own && own.pictures.length) {
      const strip = element("div", undefined, box);
      strip.className = "crops";
      for (const crop of own.pictures) {
        const frame = element("figure", undefined, strip);
        const picture = element("img", undefined, frame);
        picture.src = crop.src;
        picture.alt = crop.wide ? "the street around the sign" : "view of the sign";
        if (crop.wide) frame.className = "street";
        element("figcaption", crop.text, frame);
      }
    }
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
      // without a clock times are stamps
      const text = field.kind === "time" ? value.replace("T", " ").replace("Z", " UTC") : value + field.unit;
      if (value) line(field.title, text, field.meaning);
    });
    if (own && own.budget.length) {
      element("h4", "Where the error comes from (σ per axis)", box);
      const rows = element("table", undefined, box);
      rows.className = "budget";
      for (const [source, sd] of own.budget) {
        const line = element("tr", undefined, rows);
        element("td", source, line);
        element("td", sd.toFixed(2) + " m", line);
      }
    }
    if (own && own.views.length) views(own.views, box);
    box.parentElement.scrollTop = 0;
    markers.forEach((_, k) => mark(k, k === i));
    if (table) Array.from(table.rows).forEach((r) => r.classList.toggle("on", r.cells[0].textContent === row[column.id]));
    if (move) map.setView(at(signs.xy[i]), Math.max(map.getZoom(), 2));
  }
  // residuals of the views as dots, right and down in pixels, the near ones larger
  const SVG = "http://www.w3.org/2000/svg";
  function views(rows, box) {
    const used = rows.filter((v) => v[4] && v[2] !== null);
    const ranges = rows.map((v) => v[1]).filter((r) => r !== null);
    const span = rows[rows.length - 1][0] - rows[0][0];
    element("h4", "Views", box);
    const parts = [];
    if (ranges.length) parts.push("from " + Math.max(...ranges).toFixed(0) + " to " + Math.min(...ranges).toFixed(0) + " m");
    parts.push("over " + span.toFixed(1) + " s");
    const left = rows.length - rows.filter((v) => v[4]).length;
    if (left) parts.push(left + " not used");
    element("p", parts.join(", "), box);
    if (!used.length) return;
    const reach = Math.max(1, ...used.map((v) => Math.max(Math.abs(v[2]), Math.abs(v[3])))) * 1.15;
    const shape = (tag, attributes, parent) => {
      const e = document.createElementNS(SVG, tag);
      for (const [name, value] of Object.entries(attributes)) e.setAttribute(name, value);
      return parent.appendChild(e);
    };
    const plot = shape("svg", { viewBox: "-60 -60 120 120", class: "residuals", role: "img", "aria-label": "residuals of the views" }, box);
    shape("path", { d: "M-55 0H55M0 -55V55", class: "axis" }, plot);
    for (const v of used) {
      const r = v[1] ? Math.min(4, Math.max(1.4, 40 / v[1])) : 2;
      shape("circle", { cx: 55 * v[2] / reach, cy: 55 * v[3] / reach, r: r }, plot);
    }
    element("p", "residuals to " + reach.toFixed(1) + " px right and down; larger dots are nearer", box).className = "note";
  }
  if (table) {
    const rowOf = new Map(signs.rows.map((row, i) => [row[column.id], i]));
    for (const r of table.rows) {
      const i = rowOf.get(r.cells[0].textContent);
      if (i === undefined) continue;
      r.classList.add("pick");
      const go = () => { show(i, true); document.getElementById("map").scrollIntoView({ block: "nearest" }); };
      r.tabIndex = 0;
      r.addEventListener("click", go);
      r.addEventListener("keydown", (event) => { if (event.key === "Enter") go(); });
    }
  }

  if (!signs.rows.length) document.getElementById("sign").remove();

  // legend
  const legend = document.getElementById("legend");
  const entry = (shape, colour, text, face, parent) => {
    const line = element("div", undefined, parent || legend);
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
    const head = element("h3", "Path by ", legend);
    const choice = element("select", undefined, head);
    choice.id = "path-by";
    choice.setAttribute("aria-label", "what the path is coloured by");
    data.path.modes.forEach((mode) => { element("option", mode.title, choice).value = mode.key; });
    const swatches = element("div", undefined, legend);
    swatches.className = "swatches";
    const chosen = () => {
      const mode = data.path.modes[choice.selectedIndex];
      swatches.replaceChildren();
      if (mode) mode.labels.forEach((label, c) => entry("swatch", colourOf(c, mode.labels.length), label, null, swatches));
    };
    choice.addEventListener("change", () => { drawPath(data.path.modes[choice.selectedIndex]); chosen(); });
    chosen();
    if (data.path.outages.length) entry("swatch", css("--c3"), "no GPS (broad line)");
  }
  if (data.fixes.length) entry("dot", css("--soft"), "GPS fix");
  if (signs.rows.length) {
    element("h3", "Signs (pale: with reservation)", legend);
    const counts = new Map();
    signs.rows.forEach((row) => counts.set(row[column["class"]], (counts.get(row[column["class"]]) || 0) + 1));
    const names = [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a));
    names.slice(0, 14).forEach((name) => entry("dot", signs.colours[name] || UNKNOWN, words(name) + " (" + counts.get(name) + ")", faceOf(name)));
    if (names.length > 14) element("div", "and " + (names.length - 14) + " more classes", legend);
  }

  if (below) {
    const label = element("label", undefined, legend);
    label.className = "below-switch";
    const tick = element("input", undefined, label);
    tick.type = "checkbox";
    tick.checked = true;
    element("span", data.background.text, label);
    tick.addEventListener("change", () => { if (tick.checked) below.addTo(map); else below.remove(); drawGrid(); drawArrows(); });
  }

  // on paper the map is narrower
  const frame = map.getContainer();
  const refit = (width, height) => {
    frame.style.width = width;
    frame.style.height = height;
    map.invalidateSize({ animate: false });
    whole();
  };
  addEventListener("beforeprint", () => refit("680px", "400px"));
  addEventListener("afterprint", () => refit("", ""));

  drawGrid();
  drawArrows();
  map.on("moveend", () => { drawGrid(); drawArrows(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawGrid);
})();
