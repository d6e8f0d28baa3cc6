"""Streets without signs from the simulator: flat colours, plain shapes, none of them a sign."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from automap.simulation.camera import Painter, camera_views
from automap.simulation.scene import build_scene
from automap.simulation.trajectory import drive_motion
from pipeline.shared.configs import configs_dir
from pipeline.simulate.command import load_scenario
from pipeline.train.street_data import Street

Image = npt.NDArray[np.uint8]
PREFIX = "drawn/"
_SCENES = 8
_VIEWS = 6
_SIZE = (1360, 800)


def drawn_streets(cache: Path) -> list[Street]:
    """Views of streets laid out at random, other than the sample drive's; drawn once."""
    if not cache.is_file():
        images = [image for seed in range(_SCENES) for image in _views(9000 + seed)]
        np.save(cache, np.stack(images))
    mapped = np.load(cache, mmap_mode="r")
    none = (np.zeros((0, 4)), np.zeros(0, np.int64))
    return [Street(f"{PREFIX}{i}", image, *none) for i, image in enumerate(mapped)]


def _views(seed: int) -> list[Image]:
    rng = np.random.default_rng(seed)
    scenario = load_scenario(configs_dir() / "scenarios" / "sample.toml")
    assert scenario.camera is not None
    camera = scenario.camera.model_copy(
        update={
            "width": _SIZE[0],
            "height": _SIZE[1],
            "focal_px": float(rng.uniform(800, 1400)),
            "image_noise": float(rng.uniform(0.5, 4.0)),
        }
    )
    scenario = scenario.model_copy(update={"seed": seed, "signs": (), "camera": camera})
    motion = drive_motion(scenario, np.random.default_rng(seed))
    scene = build_scene(scenario, motion, np.random.default_rng(seed + 1))
    painter = Painter(scene, camera, float(rng.uniform(0.7, 1.15)), rng)
    times = rng.uniform(5.0, motion.duration_s - 1.0, _VIEWS)
    return [painter.paint(view) for view in camera_views(motion, camera, times, scene.ref)]
