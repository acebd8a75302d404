"""The report: one page that needs nothing else, checked in a real browser where there is one."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest
import yaml

from analysis.report.build import report
from analysis.report.page import page
from analysis.static.view import StillView, open_view
from analysis.study import Study, StudyTable
from pipeline.variance import TableVariance
from recorder.errors import InputError
from replay.result import open_result
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings
from tests import worlds
from tests.make_sample import LOG, SETTINGS

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

# What the page says of itself once it is drawn, to the page around it.
PROBE = """
<script>
const tell = data => parent.postMessage(data, "*");
addEventListener("error", e => tell({error: e.message || "resource"}), true);
addEventListener("load", () => {
  const images = [...document.images];
  const drawn = images.filter(i => i.complete && i.naturalWidth > 100 && i.clientWidth > 100);
  tell({
    images: images.length, drawn: drawn.length,
    wide: document.documentElement.scrollWidth, window: innerWidth,
    small: getComputedStyle(document.body).fontSize,
  });
});
</script></head>
"""

# A frame as wide as a screen, for no browser window is as narrow as a phone; `--dump-dom` prints
# what the page in it said.
SCREEN = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<body style="margin:0"><script>
addEventListener("message", e => Object.assign(document.body.dataset, e.data));
</script><iframe src="probed.html" style="width:{width}px;height:844px;border:0"></iframe></body>
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a drive and of a camera that stands still."""
    folder = tmp_path_factory.mktemp("report")
    options = ReplayOptions(settings=load_settings(SETTINGS), rrd=False, progress=False)
    replay(LOG, folder / "drive", "drive", options)
    still = worlds.small_log(folder / "still.mcap", 4, moving=False)
    replay(still, folder / "still", "still", ReplayOptions(rrd=False, progress=False))
    report([folder / "drive", folder / "still"], folder / "report.html", sample=50)
    return folder / "report.html"


def test_the_page_has_every_study_and_nothing_from_elsewhere(built: Path) -> None:
    text = built.read_text()
    for title in ("Comparison: sample.mcap", "Placement", "Number of markers", "Tracking"):
        assert title in text
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)[^\"]*\"", text)
    assert "@import" not in text
    assert "url(" not in text
    for name in ("opencv-contrib-python-headless", "max_markers"):
        assert name in text


def test_every_table_lies_beside_it_as_csv_and_latex(built: Path) -> None:
    files = built.with_name("report_files")
    tables = sorted(files.rglob("*.csv"))
    assert len(tables) >= 6
    for path in tables:
        assert len(pd.read_csv(path))
        tex = path.with_suffix(".tex").read_text()
        assert tex.count("\\begin{tabular}") == 1
        assert "\\toprule" in tex
    assert len(list(files.rglob("*.svg"))) >= 6


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_draws_it_without_errors(width: int, built: Path, tmp_path: Path) -> None:
    probed = tmp_path / "probed.html"
    probed.write_text(built.read_text().replace("</head>", PROBE, 1))
    screen = tmp_path / "screen.html"
    screen.write_text(SCREEN.format(width=width))
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            *(CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"),
            *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
            *("--disable-quic", "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'user'}"),
            *("--window-size=1300,900", "--virtual-time-budget=10000", "--dump-dom"),
            screen.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    body = re.search(r"<body([^>]*)>", done.stdout)
    assert body is not None, done.stderr[-2000:]
    data = dict(re.findall(r'data-(\w+)="([^"]*)"', body.group(1)))
    assert "error" not in data, data
    assert "CONSOLE" not in done.stderr
    assert int(data["images"]) >= 6
    assert data["drawn"] == data["images"]
    # Wide tables scroll in their own frame; the page itself does not.
    assert int(data["window"]) == width
    assert int(data["wide"]) <= width
    assert float(data["small"].removesuffix("px")) >= 15


def test_cells_are_escaped_and_empty_statistics_are_a_dash(built: Path) -> None:
    frame = pd.DataFrame({"name": ["<script>alert(1)</script>"], "rmse_cm": [float("nan")]})
    study = Study("s", "A & B", (StudyTable("t", "T", frame),))
    text = page("x", [study], [open_result(built.parent / "still")])
    assert "<script>" not in text
    assert "A &amp; B" in text
    assert "<td>–</td>" in text
    assert "nan" not in text.split("<main>")[1].split('id="results"')[0]


def test_the_variances_lie_beside_it_as_a_table_for_settings(built: Path) -> None:
    (path,) = built.with_name("report_files").rglob("table.yaml")
    settings = {
        "trackers": {"own": {"kind": "constant_velocity", "variance": {"kind": "table"}}},
    }
    settings["trackers"]["own"]["variance"]["path"] = str(path)  # type: ignore[index]
    (built.parent / "own.yaml").write_text(yaml.safe_dump(settings))
    variance = load_settings(built.parent / "own.yaml").trackers["own"].variance
    assert isinstance(variance, TableVariance)
    written = pd.read_csv(path.with_name("variance.csv"))
    assert variance.table.cm2[0][0] == pytest.approx(written["var_x_cm2"][0], rel=1e-5)
    assert "Variances by number of markers" in built.read_text()


def test_a_report_that_fails_leaves_nothing(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> str:
        raise RuntimeError("no page")

    monkeypatch.setattr("analysis.report.build.page", broken)
    with pytest.raises(RuntimeError, match="no page"):
        report([built.parent / "drive"], tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_new_report_has_no_files_of_the_old_and_leaves_others(
    built: Path, tmp_path: Path
) -> None:
    files = tmp_path / "r_files"
    stale = files / "9-placement" / "old.csv"
    others = [files / name for name in ("notes.txt", "1-notes.txt", "2024-photos/a.jpg")]
    for path in (stale, *others):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    report([built.parent / "drive"], tmp_path / "r.html")
    assert not stale.parent.exists()
    assert all(path.exists() for path in others)
    assert (tmp_path / "r_files" / "2-tracking").is_dir()


def test_a_result_without_a_study_is_named_and_spoils_nothing(built: Path, tmp_path: Path) -> None:
    """One where nothing was seen, and one with a damaged table."""
    log = worlds.small_log(tmp_path / "dark.mcap", 3, damaged=(0, 1, 2))
    replay(log, tmp_path / "dark", "dark", ReplayOptions(rrd=False, progress=False))
    broken = tmp_path / "broken"
    shutil.copytree(built.parent / "still", broken)
    table = broken / "detections.parquet"
    table.write_bytes(table.read_bytes()[:-50])
    folders = [built.parent / "drive", tmp_path / "dark", broken]
    written = report(folders, tmp_path / "r.html")
    assert "Tracking" in written.studies
    page_text = (tmp_path / "r.html").read_text()
    assert len(written.without) == 2
    for sentence, reason in zip(written.without, ("markers of the map", "Parquet"), strict=True):
        assert reason in sentence
        assert reason in page_text


def test_each_result_is_opened_once(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []

    def opening(folder: Path) -> StillView:
        opened.append(folder.name)
        return open_view(folder)

    for module in ("report.build", "static.placement", "static.count", "static.variance_table"):
        monkeypatch.setattr(f"analysis.{module}.open_view", opening)
    report([built.parent / "still"], tmp_path / "r.html", sample=5)
    assert opened == ["still"]


def test_a_folder_that_is_no_result(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no summary\.json"):
        report([tmp_path], tmp_path / "report.html")
    assert not list(tmp_path.iterdir())
