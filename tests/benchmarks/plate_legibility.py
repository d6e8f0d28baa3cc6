"""At what resolution a number plate can still be read, by a reader that knows nearly everything.

``python tests/benchmarks/plate_legibility.py [PLATES]`` prints for several resolutions the share of
letters and of whole plates that are read. The reader knows the letters' shape, where they stand,
their contrast and where the pixels lie, and takes the letters whose picture is nearest to what it
sees (8 bit, noise of 2 grey levels, JPEG of quality 80). People and programs that read plates know
less, so that this is more than they can do. Chance reads one letter of 36.
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

from automap.records import FloatArray, IntArray

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
COUNT, PITCH_MM, HEIGHT_MM = 7, 60, 75
RESOLUTIONS = (15, 20, 25, 30, 40, 62, 125)
NOISE_GREYS, QUALITY, BRIGHT, DARK = 2.0, 80, 220.0, 40.0
STARTS = 8


def letter(text: str) -> FloatArray:
    """Ink [110, 60] of a letter 75 mm high in 0..1, a millimetre a pixel."""
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, HEIGHT_MM / 22.0
    (width, _), _ = cv2.getTextSize(text, font, scale, 9)
    canvas = np.zeros((110, width + 20), np.uint8)
    cv2.putText(canvas, text, (10, 92), font, scale, 255, 9, cv2.LINE_AA)
    image = cv2.resize(canvas, (PITCH_MM, 110), interpolation=cv2.INTER_AREA)
    return image.astype(np.float64) / 255.0


def pixels(scene: FloatArray, mm: float, phase: FloatArray) -> FloatArray:
    """A scene [h, w] of a millimetre a pixel as a camera of pixels of ``mm`` sees it."""
    side = max(round(mm), 1)
    shift = np.array([[1.0 / mm, 0.0, phase[0]], [0.0, 1.0 / mm, phase[1]]])
    size = (int(scene.shape[1] / mm), int(scene.shape[0] / mm))
    seen = cv2.warpAffine(
        cv2.blur(scene, (side, side)), shift, size, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(seen, np.float64)


def read_plate(seen: FloatArray, shapes: FloatArray, rng: np.random.Generator) -> IntArray:
    """The letters [7] whose sum of ``shapes`` [7, 36, p] is nearest to ``seen`` [p], by exchange
    of one letter at a time from several starts."""
    best, least = np.zeros(COUNT, np.int64), np.inf
    for _ in range(STARTS):
        chosen = rng.integers(0, len(LETTERS), COUNT)
        error = np.inf
        while True:
            for k in range(COUNT):
                others = sum(shapes[j, chosen[j]] for j in range(COUNT) if j != k)
                squares = ((seen - others - shapes[k]) ** 2).sum(axis=1)
                chosen[k] = int(np.argmin(squares))
            if not squares.min() < error - 1e-9:
                break
            error = float(squares.min())
        if error < least:
            best, least = chosen.copy(), error
    return best


def main(plates: int) -> None:
    """Print the table."""
    rng = np.random.default_rng(1)
    ink = [letter(text) for text in LETTERS]
    print("px/m  letter px  letters  plates")
    for resolution in RESOLUTIONS:
        mm = 1000.0 / resolution
        right = whole = 0
        for _ in range(plates):
            truth, phase = rng.integers(0, len(LETTERS), COUNT), rng.random(2)
            plate = np.full((310, 720), DARK)
            plate[100:210, 100:620] = BRIGHT
            bare = pixels(plate, mm, phase)
            shapes = np.zeros((COUNT, len(LETTERS), bare.size))
            for k in range(COUNT):
                for i, shape in enumerate(ink):
                    scene = np.zeros_like(plate)
                    at = 150 + PITCH_MM * k
                    scene[100:210, at : at + PITCH_MM] = (DARK - BRIGHT) * shape
                    shapes[k, i] = pixels(scene, mm, phase).ravel()
            seen = bare + sum(shapes[k, truth[k]] for k in range(COUNT)).reshape(bare.shape)
            seen = seen + NOISE_GREYS * rng.standard_normal(seen.shape)
            picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
            data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            shown = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).astype(np.float64)
            read = read_plate((shown - bare).ravel(), shapes, rng)
            right += int((read == truth).sum())
            whole += bool((read == truth).all())
        letters, size = right / (COUNT * plates), HEIGHT_MM / mm
        print(f"{resolution:4} {size:10.1f} {letters:8.2f} {whole / plates:7.2f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
