"""The report as a browser reads it: self-contained, escaped, true to the run."""

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_runs import bare_run, made_run
from scipy.spatial.transform import Rotation

from evcalib.filters import Noise
from evcalib.geometry import LOOKS_FORWARD
from evcalib.pipeline import Gating, InputFile
from evcalib.pipeline._run import package_versions
from evcalib.report import _html, report_html
from evcalib.report import _text as text
from evcalib.report._page import CAPTIONS

VOID = {"img", "meta", "br"}


class Page(HTMLParser):
    """A page as a tree is walked: every tag must be closed in its turn."""

    def __init__(self, source):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.said = [], [], []
        self.feed(source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.said.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.said).split())

    def named(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]


@pytest.fixture(scope="module")
def source():
    return report_html(made_run())


@pytest.fixture(scope="module")
def page(source):
    return Page(source)


def test_nothing_is_fetched_or_run(source, page):
    assert not {"script", "link", "iframe", "object", "base", "form"} & {t for t, _ in page.tags}
    for tag, attrs in page.tags:
        assert not any(name.startswith("on") for name in attrs), tag
        for name in ("src", "href", "srcset", "action", "data", "poster"):
            assert attrs.get(name, "data:").startswith("data:"), (tag, name)
    css = source.split("<style>")[1].split("</style>")[0]
    assert "url(" not in css
    assert "@import" not in css
    assert "://" not in re.sub(r"base64,[^\"]*", "", source)


def test_all_pictures_are_png_of_the_size_that_is_said_with_words_for_those_who_do_not_see(page):
    images = page.named("img")
    assert len(images) == len(CAPTIONS)
    for image in images:
        form, data = image["src"].split(",", 1)
        assert form == "data:image/png;base64"
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        assert abs(picture.shape[1] - int(image["width"])) <= 1
        assert abs(picture.shape[0] - int(image["height"])) <= 1
        assert picture.shape[1] >= 1200
        assert picture.std() > 5
        assert len(image["alt"]) > 60


def test_light_and_dark_leave_pictures_on_white_and_paper_light(source):
    css = source.split("<style>")[1].split("</style>")[0]
    dark = css.split("prefers-color-scheme: dark")[1].split("}\n}")[0]
    light = css.split("@media")[0]
    for part in (light, dark):
        colors = dict(re.findall(r"--(\w+): (#\w{6})", part))
        assert contrast(colors["page"], colors["text"]) > 7
        assert contrast(colors["card"], colors["text"]) > 7
        assert contrast(colors["page"], colors["soft"]) > 4.5
    assert re.search(r"\.picture \{ background: #ffffff", css)
    assert "--page: #ffffff" in css.split("@media print")[1]


def contrast(a, b):
    """Return the contrast ratio of two colours (WCAG 2.1)."""

    def luminance(color):
        c = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
        return np.where(c <= 0.03928, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [
            0.2126,
            0.7152,
            0.0722,
        ]

    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_the_answer_comes_first(page):
    run = made_run()
    top = page.text.split("Result")[0]
    assert run.calibration.verdict.summary in top
    assert f"{run.calibration.offset:.4f} s ahead of the camera's" in top
    assert "What to do next" in top
    assert "yes" in page.named("div")[0]["class"]


def test_numbers_are_those_of_the_run(page):
    run = made_run()
    R = run.calibration.R_body_cam
    x, y, z, w = Rotation.from_matrix(R).as_quat(canonical=True)
    assert ", ".join(f"{q:+.6f}" for q in (w, x, y, z)) in page.text
    roll_pitch_yaw = Rotation.from_matrix(R).as_euler("ZYX", degrees=True)[::-1]
    assert ", ".join(f"{a:+.2f}" for a in roll_pitch_yaw) in page.text
    for row in R:
        assert " ".join(f"{value:+.5f}" for value in row) in page.text
    low, high = run.calibration.offset_interval
    assert f"95 % from {low:+.4f} to {high:+.4f} s" in page.text
    for said in ("1,234,567", "503", "bytes of a cut packet", "evcalib calibrate recording.txt"):
        assert said in page.text
    assert "too few corners 2" in page.text
    assert "in all 2.8 s" in page.text
    for name, value in package_versions().items():
        assert f"{name} {value}" in page.text


@pytest.mark.parametrize(
    ("rpy", "words"),
    [
        ((0, 0, 0), "forward; image upright."),
        ((0, 30, 0), "forward, tilted down by 30 deg; image upright."),
        ((0, 0, 90), "to the left; image upright."),
        ((10, 0, -20), "turned to the right by 20 deg; image rolled, its right side down"),
        ((-9, -15, 0), "up by 15 deg; image rolled, its left side down by 9 deg"),
        ((0, 90, 0), "looks down; the top of the image points forward."),
    ],
)
def test_the_mounting_in_words(rpy, words):
    turn = Rotation.from_euler("ZYX", rpy[::-1], degrees=True).as_matrix()
    run = made_run()
    calibration = replace(run.calibration, R_body_cam=turn @ LOOKS_FORWARD)
    assert words in text.findings(replace(run, calibration=calibration))[1]
    if abs(rpy[1]) < 90:
        np.testing.assert_allclose(text.mounting(calibration.R_body_cam), rpy, atol=1e-9)


def test_the_truth_is_compared_where_it_is_known():
    run = made_run()
    error = 1e3 * (run.calibration.offset - 0.2)
    assert f"off by {error:+.1f} ms" in text.findings(run)[-1]
    assert len(text.findings(bare_run(run))) == 3


def test_a_drive_that_cannot_answer_does_not_look_like_one_that_can():
    run = made_run("straight")
    page = Page(report_html(run))
    assert "no" in page.named("div")[0]["class"].split()
    top = page.text.split("Pictures")[0]
    assert "is not determined" in top
    assert "Do not use the rotation" in top
    assert "Use calibration.yaml" not in top
    for reason in (*run.calibration.verdict.reasons, *run.calibration.verdict.advice):
        assert reason in top


def test_an_offset_alone_is_no_half_truth():
    calibration = replace(made_run().calibration, offset_observable=False)
    assert text.success(calibration) == "partly"
    said = text.findings(replace(made_run(), calibration=calibration))[0]
    assert "not determined" in said


def test_what_deserves_a_look_is_said_and_only_then():
    run = made_run()
    assert text.cautions(bare_run(run)) == []
    estimate = replace(run.estimate, gaps=run.estimate.gaps[:1] * 5 * len(run.estimate.headings))
    bad = replace(run, estimate=estimate, gating=Gating(100, 30, 20, 45))
    windows, rows, losses = text.cautions(bad)
    assert windows.startswith("83 % of the windows")
    assert "too few corners" in windows
    assert rows.startswith("45 % of the wheel rows")
    assert "12 bytes of a cut packet" in losses
    assert "out of order" not in losses


def test_delays_of_the_pixels_are_said_with_the_offset_and_more_where_there_is_noise():
    run = bare_run(made_run())
    assert "pixels' own delay" in text.findings(run)[2]
    unknown = replace(run, calibration=replace(run.calibration, offset_observable=False))
    assert len(text.findings(unknown)) == 2
    for rate, said in ((1.0, 0), (6.2, 1)):
        noise = Noise(events=100, kept=60, unsupported=40, rate=rate)
        noisy = replace(run, estimate=replace(run.estimate, noise=noise))
        assert len(text.cautions(noisy)) == said
    assert "6.2 events of noise per second and pixel" in text.cautions(noisy)[0]
    assert "40.0 % of the events: 40 without enough neighbours" in Page(report_html(noisy)).text


def test_a_bare_run_has_a_report_too():
    page = Page(report_html(bare_run(made_run())))
    assert len(page.named("img")) == len(CAPTIONS) - 2


def test_the_same_run_gives_the_same_page(source):
    assert report_html(made_run()) == source


NASTY = "<script>alert('1')</script> \"&amp; \x00\u202e\udcff ä"


def test_whatever_text_comes_in_stays_text():
    run = made_run()
    mark = run.estimate.gaps[0].__class__
    nasty = replace(
        run,
        recording={NASTY: NASTY},
        losses={NASTY: 3},
        settings={NASTY: NASTY},
        versions={NASTY: NASTY},
        timings={NASTY: 1.0},
        command=NASTY,
        files={NASTY: InputFile(NASTY, 1)},
        estimate=replace(run.estimate, gaps=(mark(0.1, "<b>x</b>"),)),
    )
    source = report_html(nasty)
    source.encode("utf-8")
    page = Page(source)
    assert not {"script", "b"} & {tag for tag, _ in page.tags}
    assert page.text.count("<script>alert('1')</script> \"&amp;") >= 9
    assert "\x00" not in source
    assert "\u202e" not in source


@settings(deadline=None, max_examples=200)
@given(st.text())
def test_escaping_shows_what_came_in(any_text):
    class Reader(HTMLParser):
        def handle_data(self, data):
            seen.append(data)

        def handle_starttag(self, tag, attrs):
            values.update(attrs)

    seen, values = [], {}
    shown = _html.tag("p", any_text, title=any_text)
    reader = Reader()
    reader.feed(shown)
    reader.close()
    assert list(values) == ["title"]
    assert "".join(seen) == values["title"]
    kept = "".join(seen)
    assert len(kept) == len(any_text)
    assert all(a == b or b == "\ufffd" for a, b in zip(any_text, kept, strict=True))
