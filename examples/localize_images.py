"""The pipeline as a library: a folder of images, one line of position each.

python examples/localize_images.py IMAGES camera.yaml map.yaml
"""

from __future__ import annotations

import sys
from pathlib import Path

from pipeline.localizer import Frame, Localizer, PipelineSettings
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.image_decoding import decode_gray


def main(images: Path, camera_path: Path, map_path: Path) -> None:
    camera = parse_camera(camera_path.read_bytes(), camera_path)
    marker_map = parse_map(map_path.read_bytes(), map_path)
    localizer = Localizer(PipelineSettings(), camera, marker_map, start_ns=0)
    for index, path in enumerate(sorted(images.iterdir())):
        image = decode_gray(path.read_bytes())
        result = localizer.step(Frame(index, index * 100_000_000, image))
        pose = result.fix.T_map_camera
        where = "-" if pose is None else " ".join(f"{value:+.3f}" for value in pose.translation)
        print(f"{path.name}: {result.fix.status}, {result.fix.n_used} markers, {where}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*(Path(argument) for argument in sys.argv[1:4]))
