"""A variance model of one's own: a camera that is known to be level trusts a fix by its tilt.

A pose that tilts by an angle to fit the corners moves by about the distance to the markers times
that angle, along the axis that it tilts to: the tilt of a level camera is a measure of the error.

    python examples/own_variance.py LOG RESULT settings.yaml
"""

from __future__ import annotations

import sys
from pathlib import Path

from pydantic import PositiveFloat

from analysis.compare import as_text, compare
from pipeline.pose import PoseFix
from pipeline.tracker import ConstantVelocity
from pipeline.variance import CustomVariance, Variance
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings


class LevelCameraVariance(CustomVariance):
    """σ = `std_m` beside the displacement that the tilt along the axis stands for."""

    std_m: PositiveFloat = 0.01

    def __call__(self, fix: PoseFix) -> Variance:
        if fix.T_map_camera is None:
            raise ValueError("expected a fix with a pose")
        # The optical axis in the map: its x and y are the sines of the tilt.
        axis_x, axis_y, _ = fix.T_map_camera.rotation[:, 2].tolist()
        x_m, y_m = fix.mean_distance_m * axis_x, fix.mean_distance_m * axis_y
        return Variance(self.std_m**2 + x_m**2, self.std_m**2 + y_m**2)


def main(log: Path, result: Path, settings_path: Path) -> None:
    settings = load_settings(settings_path)
    first = next(iter(settings.trackers.values()))
    level = ConstantVelocity(accel_std=first.accel_std, variance=LevelCameraVariance())
    settings = settings.model_copy(update={"trackers": {**settings.trackers, "level": level}})
    replay(log, result, "level", ReplayOptions(settings=settings, rrd=False, force=True))
    print(as_text(compare([result])))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*(Path(argument) for argument in sys.argv[1:4]))
