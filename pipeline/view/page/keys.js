// Everything by keyboard.
import { ordered } from "./signs.js";

const KEYS = [
  ["n, p", "next, previous sign that the filters show"],
  ["u", "next sign that is not reviewed"],
  ["d", "most doubtful sign that is not reviewed"],
  ["a", "accept the sign"],
  ["x", "reject the sign"],
  ["c", "choose its class among all: type a name or a number, arrows, Enter"],
  ["m", "move it: drag or arrows, Enter keeps it, Esc leaves it"],
  ["r", "turn it: drag or arrows, Enter keeps it, Esc leaves it"],
  ["h", "set its height above the road"],
  ["j", "make it one with another: go there, Enter"],
  ["k", "split its views into two signs"],
  ["i", "add a sign that was missed: on the map, or in two frames (Tab to the frame, arrows, Enter)"],
  ["t", "write a note"],
  ["z", "undo what you decided last"],
  ["[, ]", "previous, next view of the sign"],
  ["space", "play, pause"],
  [", .", "one frame back, on (with shift ten)"],
  ["arrows", "move the map"],
  ["+, -", "zoom"],
  ["Home", "the whole map"],
  ["f", "show or hide the filters"],
  ["b", "show or hide the background"],
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
    const order = app.order ??= ordered(signs, byId("order").value);
    let at = state.selected === null ? (step > 0 ? -1 : signs.n) : order.indexOf(state.selected);
    for (let k = 0; k < signs.n; k++) {
      at = (at + step + signs.n) % signs.n;
      const row = order[at];
      if (signs.shown[row] && wanted(row)) {
        app.hint("");
        app.select(row);
        return;
      }
    }
    app.hint("No further sign.");
  };
  byId("previous").onclick = () => next(-1);
  byId("next").onclick = () => next(1);
  const doubtful = () => {
    const row = ordered(state.signs, "doubt").find((i) => state.signs.shown[i] && !state.signs.verdicts.get(i)?.status && i !== state.selected);
    if (row === undefined) return app.hint("No further sign.");
    app.hint("");
    app.select(row);
  };
  const focus = (id) => { const e = byId(id); if (e) { e.focus(); e.select(); } };
  const arrow = (dx, dy, e) => {
    if (review.nudge(dx, -dy, e.shiftKey)) return;
    map.panBy(dx * 80, dy * 80);
  };
  const actions = {
    n: () => next(1), p: () => next(-1),
    u: () => next(1, (row) => !state.signs.verdicts.get(row)?.status),
    a: () => review.accept(), x: () => review.reject(), m: () => review.startMove(), z: () => review.undo(),
    c: () => review.chooseClass(), t: () => focus("note"), d: doubtful, h: () => focus("height"),
    r: () => review.startTurn(), j: () => review.startMerge(), k: () => review.startSplit(), i: () => review.startAdd(),
    b: () => app.toggleBelow(),
    "[": () => card.stepView(-1), "]": () => card.stepView(1),
    " ": () => player.toggle(),
    ",": () => player.step(-1), ".": () => player.step(1), "<": () => player.step(-10), ">": () => player.step(10), ";": () => player.step(-10), ":": () => player.step(10),
    ArrowLeft: (e) => arrow(-1, 0, e), ArrowRight: (e) => arrow(1, 0, e), ArrowUp: (e) => arrow(0, -1, e), ArrowDown: (e) => arrow(0, 1, e),
    "+": () => map.zoomBy(1.5), "=": () => map.zoomBy(1.5), "-": () => map.zoomBy(1 / 1.5),
    Home: () => app.wholeMap(), f: () => app.filters.toggle(), "?": () => byId("help").showModal(),
    Enter: () => review.save(),
    Escape: () => (review.busy ? review.leave() : app.select(null)),
  };

  addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || byId("help").open || byId("picker").open) return;
    const at = document.activeElement;
    const typing = at && (at.tagName === "TEXTAREA" || at.tagName === "SELECT" || (at.tagName === "INPUT" && at.type !== "checkbox" && at.type !== "range"));
    if (typing) { if (e.key === "Escape") at.blur(); return; }
    // a button or a slider that has the focus keeps its own keys
    if (at && (at.tagName === "BUTTON" || at.tagName === "A") && (e.key === " " || e.key === "Enter")) return;
    if (at === byId("frame") && state.adding && player.pointKey(e)) { e.preventDefault(); return; }
    if (at && at.type === "checkbox" && e.key === " ") return;
    if (at && at.type === "range" && (e.key.startsWith("Arrow") || e.key === "Home") ) return;
    const action = Object.hasOwn(actions, e.key) ? actions[e.key] : null;
    if (!action) return;
    if (e.key === "Enter" && !review.busy) return;
    e.preventDefault();
    action(e);
  });
}
