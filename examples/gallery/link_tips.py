"""The paper's experiment figure [fig:exp_10]: X_i and Y_i of the link tips, measured and modelled, pressure below.

The pulse of 119 kPa is predicted from fits at 60 and 180 kPa. Run: python examples/gallery/link_tips.py [picture.png]
"""

import sys
from pathlib import Path

import pliant
from pliant.plotting import save_figure
from pliant.study import demo_study
from pliant.validation.figures import record_figure


def main(path: Path) -> None:
    """Draw the figure into `path`."""
    outcome = pliant.run_study(pliant.load_study(demo_study()))
    record = next(r for r in outcome.fits[0].records if r.name == "pulse_119")
    save_figure(record_figure(record), path)
    print(outcome.verdict[0])


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "link_tips.png"))
