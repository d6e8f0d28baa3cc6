"""Sign faces set into photographs: perspective, light, dirt, poles, plates, and what is no sign."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

Image = npt.NDArray[np.uint8]
Random = np.random.Generator


def worn(face: Image, rng: Random, size: float) -> Image:
    """A face with faded colours, dirt, a shadow or a reflection; BGRA of about ``size`` px."""
    height, width = face.shape[:2]
    scale = min(1.0, 2.0 * size / max(height, width))
    if scale < 0.9:
        shape = (max(6, round(width * scale)), max(6, round(height * scale)))
        face = np.asarray(cv2.resize(face, shape, interpolation=cv2.INTER_AREA), np.uint8)
    colour = face[:, :, :3].astype(np.float32)
    height, width = face.shape[:2]
    if rng.random() < 0.4:
        grey = colour.mean(axis=2, keepdims=True)
        fade = rng.uniform(0.0, 0.5)
        colour = colour * (1 - fade) + fade * (0.6 * grey + 0.4 * rng.uniform(90, 200))
    if rng.random() < 0.5:
        # inks differ from maker to maker
        colour = colour * rng.uniform(0.8, 1.15, 3).astype(np.float32) + rng.uniform(0, 25)
    if rng.random() < 0.35:
        a = rng.uniform(0, 2 * np.pi)
        y, x = np.mgrid[0:height, 0:width].astype(np.float32)
        ramp = (np.cos(a) * x / width + np.sin(a) * y / height)[:, :, None]
        if rng.random() < 0.4:
            # the edge of a shadow
            ramp = 1.0 / (1.0 + np.exp(-(ramp - ramp.mean()) * rng.uniform(8, 40)))
        colour = colour * (1.0 + rng.uniform(-0.55, 0.35) * ramp)
    if rng.random() < 0.15:
        spots = cv2.resize(
            rng.standard_normal((5, 5), np.float32), (width, height), interpolation=cv2.INTER_CUBIC
        )
        dirt = np.clip(spots - 0.6, 0, 1)[:, :, None] * rng.uniform(0.3, 1.0)
        colour = colour * (1 - dirt) + dirt * rng.uniform(40, 120, 3).astype(np.float32)
    return np.dstack([np.clip(colour, 0, 255).astype(np.uint8), face[:, :, 3]])


def _quad(rng: Random, box: FloatArray) -> npt.NDArray[np.float32]:
    """Corners of a plane face that fills ``box``, turned about its axes."""
    yaw, pitch, roll = rng.normal(0, 0.35), rng.normal(0, 0.08), rng.normal(0, 0.06)
    yaw = float(np.clip(yaw, -0.95, 0.95))
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    turn = (
        np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        @ np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    )
    points = corners @ turn.T
    depth = 1.0 + points[:, 2:] * rng.uniform(0.02, 0.12)
    flat = points[:, :2] / depth
    centre, half = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2
    return np.asarray(centre + flat * half, np.float32)


def _local_light(image: Image, box: FloatArray) -> float:
    """How bright a white face would be here, from what is around."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = (int(v) for v in box)
    grow = max(8, x1 - x0)
    part = image[
        max(0, y0 - grow) : min(height, y1 + grow), max(0, x0 - grow) : min(width, x1 + grow)
    ]
    return float(np.percentile(part, 70)) if part.size else 128.0


def draw_face(image: Image, face: Image, box: FloatArray, rng: Random) -> FloatArray | None:
    """Set a BGRA face into ``image`` in place; its outline's box, or None outside."""
    height, width = image.shape[:2]
    size = float((box[2:] - box[:2]).max())
    art = worn(face, rng, size)
    high, wide = art.shape[:2]
    quad = _quad(rng, box)
    low = np.floor(quad.min(axis=0)).astype(int) - 3
    top = np.ceil(quad.max(axis=0)).astype(int) + 4
    low, top = np.maximum(low, 0), np.minimum(top, [width, height])
    if (top - low < 4).any():
        return None
    # drawn at several times the size and averaged, so that edges mix as a sensor mixes them
    over = 3 if size < 60 else 1
    source = np.array([[0, 0], [wide, 0], [wide, high], [0, high]], np.float32) - 0.5
    target = (quad - low + 0.5) * over - 0.5
    matrix = cv2.getPerspectiveTransform(source, np.asarray(target, np.float32))
    full = ((top - low) * over).tolist()
    # one in six stands against the light
    gain = rng.uniform(0.75, 1.6) if rng.random() < 5 / 6 else rng.uniform(0.2, 0.75)
    light = np.clip(_local_light(image, box) * gain, 20, 250) / 245.0
    art = art.astype(np.float32)
    art[:, :, :3] *= light * art[:, :, 3:] / 255.0
    patch = cv2.warpPerspective(art, matrix, (full[0], full[1]), flags=cv2.INTER_LINEAR)
    if over > 1:
        patch = cv2.resize(patch, (full[0] // over, full[1] // over), interpolation=cv2.INTER_AREA)
    cover = np.asarray(patch[:, :, 3:] / 255.0, np.float32)
    if int((cover > 0.5).sum()) < 8:
        return None
    sharp = rng.uniform(0.0, 1.1)
    if sharp > 0.35:
        patch = cv2.GaussianBlur(patch, (0, 0), sharp)
        cover = np.asarray(patch[:, :, 3:] / 255.0, np.float32)
    if rng.random() < 0.12:
        _hide(cover, rng)
    part = image[low[1] : top[1], low[0] : top[0]]
    colour = patch[:, :, :3] * (cover / np.maximum(patch[:, :, 3:] / 255.0, 1e-3))
    part[:] = np.clip(part * (1 - cover) + colour, 0, 255).astype(np.uint8)
    outline = cv2.perspectiveTransform(_outline(face, wide, high)[None], matrix)[0]
    outline = (outline + 0.5) / over - 0.5 + low
    return np.concatenate([outline.min(axis=0), outline.max(axis=0)]).astype(np.float64)


def _outline(face: Image, wide: int, high: int) -> npt.NDArray[np.float32]:
    """Points [n, 2] of a face's outline, in a drawing of it ``wide`` by ``high``."""
    solid = (face[:, :, 3] > 127).astype(np.uint8)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    hull = cv2.convexHull(np.concatenate(contours))[:, 0].astype(np.float32)
    # contours run through pixel centres, the outline around the pixels
    middle = hull.mean(axis=0)
    hull += np.sign(hull - middle) * 0.5
    size = np.array([face.shape[1], face.shape[0]], np.float32)
    return np.asarray((hull + 0.5) / size * np.array([wide, high], np.float32) - 0.5, np.float32)


def _hide(cover: npt.NDArray[np.float32], rng: Random) -> None:
    """Something in front of a part of it: a branch, a pole."""
    height, width = cover.shape[:2]
    if rng.random() < 0.5:
        x = int(rng.uniform(0.1, 0.9) * width)
        cover[:, x : x + max(1, int(0.12 * width))] = 0.0
    else:
        y, x = int(rng.uniform(0, height)), int(rng.choice([0, width]))
        mask = np.ones((height, width), np.float32)
        cv2.circle(mask, (x, y), int(0.33 * width), 0.0, -1)
        cover *= mask[:, :, None]


def pole(image: Image, box: FloatArray, rng: Random) -> None:
    """A post from a face down to the ground, in place."""
    x = int((box[0] + box[2]) / 2 + rng.normal(0, 0.05) * (box[2] - box[0]))
    wide = max(1, round((box[2] - box[0]) * rng.uniform(0.05, 0.11)))
    tone = _local_light(image, box) * rng.uniform(0.4, 1.0)
    tint = rng.uniform(0.92, 1.08, 3) * tone
    colour = (float(tint[0]), float(tint[1]), float(tint[2]))
    bottom = int(box[3] + (box[3] - box[1]) * rng.uniform(1.0, 5.0))
    cv2.line(image, (x, int((box[1] + box[3]) / 2)), (x, bottom), colour, wide, cv2.LINE_AA)


def no_sign(
    image: Image,
    rng: Random,
    at: tuple[float, float] | None = None,
    size: float | None = None,
) -> FloatArray:
    """Something that could be taken for a sign, in place: lamps, wheels, letters, sign backs.

    ``at`` its middle and ``size`` its height in px, both at random if not given. Its box.
    """
    height, width = image.shape[:2]
    if size is None:
        size = float(np.exp(rng.uniform(np.log(8), np.log(70))))
    if at is None:
        at = (rng.uniform(0, width), rng.uniform(0, height))
    x, y = int(at[0]), int(at[1])
    box = np.array([x - size / 2, y - size / 2, x + size / 2, y + size / 2])
    light = _local_light(image, box)
    kind = rng.integers(0, 8)
    any_colour = tuple(float(v) for v in rng.uniform(0, 255, 3))
    if kind == 0:
        body = tuple(float(v) for v in rng.uniform(10, 60, 3))
        body_wide = int(size * 0.4)
        cv2.rectangle(
            image,
            (x - body_wide // 2, int(y - size / 2)),
            (x + body_wide // 2, int(y + size / 2)),
            body,
            -1,
        )
        lamps = [(30, 30, 230), (30, 170, 240), (120, 220, 60)]
        on = int(rng.integers(0, 3))
        for i in range(3):
            tone = lamps[i] if i == on or rng.random() < 0.15 else (35, 35, 35)
            lamp = (x, int(y + (i - 1) * size * 0.3))
            cv2.circle(image, lamp, max(1, int(size * 0.12)), tone, -1, cv2.LINE_AA)
    elif kind == 1:
        squeeze = rng.uniform(0.4, 1.0)
        axes = (max(2, int(size / 2 * squeeze)), max(2, int(size / 2)))
        cv2.ellipse(image, (x, y), axes, 0, 0, 360, (25, 25, 25), -1, cv2.LINE_AA)
        inner = (int(axes[0] * 0.65), int(axes[1] * 0.65))
        rim = (light, light, light) if rng.random() < 0.7 else (70.0, 70.0, 75.0)
        cv2.ellipse(image, (x, y), inner, 0, 0, 360, rim, max(1, int(size * 0.08)), cv2.LINE_AA)
        for a in np.linspace(0, 2 * np.pi, int(rng.integers(4, 9)))[:-1]:
            end = (int(x + inner[0] * np.cos(a)), int(y + inner[1] * np.sin(a)))
            cv2.line(image, (x, y), end, rim, max(1, int(size * 0.06)), cv2.LINE_AA)
    elif kind == 2:
        letters = "".join(rng.choice(list("ABDEGHKLMNOPRSTUZ0123456789"), int(rng.integers(1, 8))))
        font = int(rng.integers(0, 5))
        thick = max(1, int(size / 12))
        if rng.random() < 0.5:
            board = int(size * 0.7 * len(letters))
            ground = tuple(float(v) for v in rng.uniform(0, 255, 3))
            cv2.rectangle(
                image, (x - 3, int(y - size)), (x + board, int(y + size * 0.4)), ground, -1
            )
        cv2.putText(image, letters, (x, y), font, size / 28, any_colour, thick, cv2.LINE_AA)
    elif kind == 3:
        shade = light * rng.uniform(0.35, 0.8)
        tone3 = (shade * 1.02, shade, shade * 0.98)
        if rng.random() < 0.5:
            cv2.circle(image, (x, y), int(size / 2), tone3, -1, cv2.LINE_AA)
        else:
            corners = [
                (x - size / 2, y + size / 2),
                (x + size / 2, y + size / 2),
                (x, y - size / 2),
            ]
            if rng.random() < 0.4:
                corners = [(a, 2 * y - b) for a, b in corners]
            cv2.fillPoly(image, [np.array(corners, np.int32)], tone3, cv2.LINE_AA)
        pole(image, box, rng)
    elif kind == 4:
        # a single bright lamp with its glow, red or amber or white
        glow = np.array([(40, 40, 255), (60, 180, 255), (235, 245, 255)][int(rng.integers(0, 3))])
        radius = max(1, int(size * 0.2))
        x0, y0, x1, y1 = (
            max(0, x - 3 * radius),
            max(0, y - 3 * radius),
            x + 3 * radius,
            y + 3 * radius,
        )
        part = image[y0:y1, x0:x1]
        if part.size:
            yy, xx = np.mgrid[y0 : y0 + part.shape[0], x0 : x0 + part.shape[1]].astype(np.float32)
            near = np.hypot(xx - x, yy - y) / radius
            alpha = np.clip(np.exp(-np.maximum(near - 0.8, 0) * 1.5), 0, 1)[:, :, None]
            part[:] = (part * (1 - alpha) + alpha * glow).astype(np.uint8)
    elif kind == 5:
        w, h = size * rng.uniform(0.3, 1.6), size * rng.uniform(0.3, 1.6)
        corner = (int(x + w), int(y + h))
        cv2.rectangle(image, (x, y), corner, any_colour, -1 if rng.random() < 0.7 else 2)
    elif kind == 6:
        # a plain ball in two tones: foliage, a balloon, a lamp that is off
        for shift, shade in ((0.0, 0.75), (0.12 * size, 1.0)):
            tone6 = tuple(float(np.clip(v * shade, 0, 255)) for v in any_colour)
            at6 = (int(x - shift), int(y - shift))
            cv2.circle(image, at6, int(size * 0.5 * (shade + 0.1)), tone6, -1, cv2.LINE_AA)
    else:
        # a row of windows or panels
        w, h = size * rng.uniform(0.4, 0.9), size * rng.uniform(0.4, 1.1)
        for k in range(int(rng.integers(2, 6))):
            left = int(x + (k - 1) * w * 1.6)
            corner = (int(left + w), int(y + h / 2))
            cv2.rectangle(image, (left, int(y - h / 2)), corner, any_colour, -1)
    return box
