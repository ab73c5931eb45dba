"""Make README's picture: ``python notebooks/_make_pictures.py``."""

from pathlib import Path

from data_tools.runs.demo import demo_streams
from evcalib.alignment import align
from evcalib.plots import style
from evcalib.plots.alignment import draw_curve, draw_directions

streams = demo_streams()
calibration = align(streams.headings, streams.velocities)
assert calibration.curve is not None
with style.context():
    figure = style.new_figure((8.2, 7.0))
    top, *directions = figure.subplots(3, 1, height_ratios=(1.2, 1, 1))
    interval = calibration.offset_interval
    draw_curve(
        top, calibration.curve, found=calibration.offset, interval=interval, true=streams.offset
    )
    draw_directions(directions, calibration)
target = Path(__file__).parent / "pictures" / "demo.png"
target.parent.mkdir(exist_ok=True)
target.write_bytes(style.png(figure))
