// Everything by keyboard.

const KEYS = [
  ["n, p", "next, previous sign that the filters show"],
  ["u", "next sign that is not reviewed"],
  ["a", "accept the sign"],
  ["x", "reject the sign"],
  ["c", "correct its class (Enter keeps it)"],
  ["m", "move it: drag or arrows, Enter keeps it, Esc leaves it"],
  ["t", "write a note"],
  ["z", "undo the last decision"],
  ["[, ]", "previous, next view of the sign"],
  ["space", "play, pause"],
  [", .", "one frame back, on (with shift ten)"],
  ["arrows", "move the map"],
  ["+, -", "zoom"],
  ["Home", "the whole map"],
  ["f", "show or hide the filters"],
  ["Esc", "leave a field, or no sign"],
  ["?", "these keys"],
];

export function listenToKeys(app) {
  const { byId, state, map, review, card, player } = app;
  const list = byId("keys");
  for (const [keys, text] of KEYS) {
    const dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = keys; dd.textContent = text;
    list.append(dt, dd);
  }
  byId("help-button").onclick = () => byId("help").showModal();

  const next = (step, wanted = () => true) => {
    const { signs } = state;
    if (!signs.n) return;
    let row = state.selected ?? (step > 0 ? -1 : signs.n);
    for (let k = 0; k < signs.n; k++) {
      row = (row + step + signs.n) % signs.n;
      if (signs.shown[row] && wanted(row)) {
        app.hint("");
        app.select(row);
        return;
      }
    }
    app.hint("No further sign.");
  };
  const focus = (id) => { const e = byId(id); if (e) { e.focus(); e.select(); } };
  const arrow = (dx, dy, e) => {
    if (state.moving) return review.nudgeMetres(dx * (e.shiftKey ? 1 : 0.1), -dy * (e.shiftKey ? 1 : 0.1));
    map.panBy(dx * 80, dy * 80);
  };
  const actions = {
    n: () => next(1), p: () => next(-1),
    u: () => next(1, (row) => !state.signs.verdicts.get(row)?.status),
    a: () => review.accept(), x: () => review.reject(), m: () => review.startMove(), z: () => review.undo(),
    c: () => focus("class-name"), t: () => focus("note"),
    "[": () => card.stepView(-1), "]": () => card.stepView(1),
    " ": () => player.toggle(),
    ",": () => player.step(-1), ".": () => player.step(1), "<": () => player.step(-10), ">": () => player.step(10), ";": () => player.step(-10), ":": () => player.step(10),
    ArrowLeft: (e) => arrow(-1, 0, e), ArrowRight: (e) => arrow(1, 0, e), ArrowUp: (e) => arrow(0, -1, e), ArrowDown: (e) => arrow(0, 1, e),
    "+": () => map.zoomBy(1.5), "=": () => map.zoomBy(1.5), "-": () => map.zoomBy(1 / 1.5),
    Home: () => app.wholeMap(), f: () => app.filters.toggle(), "?": () => byId("help").showModal(),
    Enter: () => review.saveMove(),
    Escape: () => (state.moving ? review.cancelMove() : app.select(null)),
  };

  addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || byId("help").open) return;
    const at = document.activeElement;
    const typing = at && (at.tagName === "TEXTAREA" || at.tagName === "SELECT" || (at.tagName === "INPUT" && at.type !== "checkbox" && at.type !== "range"));
    if (typing) { if (e.key === "Escape") at.blur(); return; }
    // a button or a slider that has the focus keeps its own keys
    if (at && at.tagName === "BUTTON" && (e.key === " " || e.key === "Enter") && !state.moving) return;
    if (at && at.type === "checkbox" && e.key === " ") return;
    if (at && at.type === "range" && (e.key.startsWith("Arrow") || e.key === "Home") && !state.moving) return;
    const action = Object.hasOwn(actions, e.key) ? actions[e.key] : null;
    if (!action) return;
    if (e.key === "Enter" && !state.moving) return;
    e.preventDefault();
    action(e);
  });
}
