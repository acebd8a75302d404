"""`make paper`: runs everything and writes docs/paper.md."""

from __future__ import annotations

import time
from pathlib import Path

import click
from tqdm import tqdm


@click.command()
@click.option("--seeds", type=click.IntRange(min=2), help="How many [20].")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("docs/paper.md"),
    help="The page.",
)
def main(seeds: int | None, output: Path) -> None:
    """Reproduces the paper in simulation and writes the page."""
    from analysis.paper.experiments import run, ticks
    from analysis.paper.page import write_page
    from analysis.paper.site import SEEDS

    seeds = seeds or SEEDS
    started = time.perf_counter()
    with tqdm(total=ticks(seeds), desc="paper", unit="part", disable=None) as bar:

        def tick() -> None:
            bar.update()

        runs = run(seeds, tick)
    write_page(runs, output)
    click.echo(f"{output}: {time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
