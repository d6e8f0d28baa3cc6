"use strict";
// Maps of a plane whose x is east and y is north, both in metres.
const plane = {
  css: (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim(),
  at: (p) => L.latLng(p[1], p[0]),
  ellipse(p, major, minor, azimuth) {
    const points = [], s = Math.sin(azimuth), c = Math.cos(azimuth);
    for (let k = 0; k < 40; k++) {
      const a = major * Math.cos(k * Math.PI / 20), b = minor * Math.sin(k * Math.PI / 20);
      points.push(plane.at([p[0] + a * s - b * c, p[1] + a * c + b * s]));
    }
    return points;
  },
  map(box, options) {
    const map = L.map(box, {
      crs: L.CRS.Simple, preferCanvas: true, attributionControl: false,
      minZoom: -10, zoomSnap: 0.25, zoomDelta: 0.75, wheelPxPerZoomLevel: 90, ...options,
    });
    L.control.scale({ imperial: false, maxWidth: 140 }).addTo(map);
    return map;
  },
};
