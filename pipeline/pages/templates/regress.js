"use strict";
(function () {
  const maps = JSON.parse(document.getElementById("maps").textContent);
  const { at, css, ellipse } = plane;
  const COLOUR = { then: css("--c1"), now: css("--c0") };
  const text = (words) => { const e = document.createElement("span"); e.textContent = words; return e; };

  function draw(details) {
    const box = details.querySelector(".overlay");
    const data = maps[Number(details.dataset.map)];
    if (!box || !data || box.dataset.drawn) return;
    box.dataset.drawn = "yes";
    const map = plane.map(box, { maxZoom: 9, scrollWheelZoom: true });
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
