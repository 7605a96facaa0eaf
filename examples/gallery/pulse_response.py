"""The paper's model without any recording: link tips under its pulse of 119 kPa, K_b and D as printed.

Run: python examples/gallery/pulse_response.py [picture.png]
"""

import sys
from pathlib import Path

import pliant
from pliant.actuators import chen2018
from pliant.plotting import save_figure
from pliant.validation.use_figures import motion_figure


def main(path: Path) -> None:
    """Draw the figure into `path`."""
    model = chen2018.model()
    pulse = pliant.Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
    motion = pliant.simulate(model, pulse, duration=4.5)
    save_figure(motion_figure(motion), path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "pulse_response.png"))
