"""The hunt for silently wrong results, as one table that anybody can make again.

``python tests/campaign.py --trials 125 --seed 1000 --workers 2 --folder DIR`` runs the study
``campaign`` and writes ``tests/campaign.csv``, a row per error of the model.  Killed, the same
command goes on.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from data_tools.studies import run_study
from data_tools.studies.campaign import verdicts

TABLE = Path(__file__).with_suffix(".csv")


def main() -> None:
    parser = argparse.ArgumentParser(description="Hunt for silently wrong results.")
    parser.add_argument("--trials", type=int, default=125, help="of each error, in each run")
    parser.add_argument("--seed", type=int, default=[1000], nargs="+", help="a run for each")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--folder", type=Path, required=True, help="where the runs are kept")
    parser.add_argument("--table", type=Path, default=TABLE)
    options = parser.parse_args()
    results = [
        run_study("campaign", trials=options.trials, seed=seed, workers=options.workers,
                  folder=options.folder / f"seed-{seed}")
        for seed in options.seed
    ]  # fmt: skip
    rows = verdicts(results)
    with options.table.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print(*row.values(), sep="\t")


if __name__ == "__main__":
    main()
