"use strict";
(function () {
  const maps = JSON.parse(document.getElementById("maps").textContent);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const COLOUR = { then: css("--c1"), now: css("--c0") };
  // the plane's x is east and y is north, both in metres
  const at = (p) => L.latLng(p[1], p[0]);
  const text = (words) => { const e = document.createElement("span"); e.textContent = words; return e; };

  function ellipse(p, major, minor, azimuth) {
    const points = [], s = Math.sin(azimuth), c = Math.cos(azimuth);
    for (let k = 0; k < 40; k++) {
      const a = major * Math.cos(k * Math.PI / 20), b = minor * Math.sin(k * Math.PI / 20);
      points.push(at([p[0] + a * s - b * c, p[1] + a * c + b * s]));
    }
    return points;
  }

  function draw(details) {
    const box = details.querySelector(".overlay");
    const data = maps[Number(details.dataset.map)];
    if (!box || !data || box.dataset.drawn) return;
    box.dataset.drawn = "yes";
    const map = L.map(box, {
      crs: L.CRS.Simple, preferCanvas: true, attributionControl: false,
      minZoom: -10, maxZoom: 9, zoomSnap: 0.25, zoomDelta: 0.75, wheelPxPerZoomLevel: 90, scrollWheelZoom: true,
    });
    L.control.scale({ imperial: false, maxWidth: 140 }).addTo(map);
    const bounds = L.latLngBounds([]);
    for (const kind of ["then", "now"]) {
      if (!data[kind]) continue;
      data[kind].path.forEach((p) => bounds.extend(at(p)));
      data[kind].signs.forEach((s) => bounds.extend(at(s.at)));
    }
    map.fitBounds(bounds.isValid() ? bounds.pad(0.05) : [[-50, -50], [50, 50]], { animate: false, maxZoom: 3 });
    const layers = {};
    for (const kind of ["then", "now"]) {
      const run = data[kind];
      if (!run) continue;
      const group = L.layerGroup().addTo(map), colour = COLOUR[kind];
      const stored = kind === "then";
      L.polyline(run.path.map(at), { color: colour, weight: stored ? 6 : 2, opacity: stored ? 0.45 : 1, interactive: false }).addTo(group);
      run.epochs.forEach((p, i) => {
        L.polygon(ellipse(p, run.sd[i][1], run.sd[i][0], 0), { color: colour, weight: 1, opacity: 0.6, fillOpacity: 0.04, interactive: false }).addTo(group);
        L.circleMarker(at(p), { radius: stored ? 3.5 : 2, color: colour, weight: 1, fillOpacity: stored ? 0 : 1, interactive: false }).addTo(group);
      });
      for (const sign of run.signs) {
        if (sign.ellipse) L.polygon(ellipse(sign.at, ...sign.ellipse), { color: colour, weight: 1.2, fillOpacity: 0.06, interactive: false }).addTo(group);
        L.circleMarker(at(sign.at), { radius: stored ? 8 : 5, color: colour, weight: stored ? 3 : 1, fillColor: colour, fillOpacity: stored ? 0 : 0.9 })
          .bindTooltip(text((stored ? "stored: " : "now: ") + sign.name + ", confidence " + sign.confidence)).addTo(group);
      }
      layers[stored ? "stored" : "now"] = group;
    }
    L.control.layers(null, layers, { collapsed: false }).addTo(map);
  }

  for (const details of document.querySelectorAll("details.drive")) {
    if (details.open) draw(details);
    details.addEventListener("toggle", () => { if (details.open) draw(details); });
  }
})();
