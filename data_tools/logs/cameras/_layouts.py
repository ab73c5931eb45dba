"""Where the cameras stand in a file's content, and one reader for each layout of a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from data_tools.logs.cameras._intrinsics import (
    PLAIN,
    Intrinsics,
    Node,
    flat,
    intrinsics,
    matrix,
    named,
    number,
    numbers,
    plain_keys,
    size_of,
    whole_size,
    word,
)
from evcalib.errors import InputError

Reader = Callable[[Node], Intrinsics]

_DEEPEST = 6
_FOR_ALL = ("imagewidth", "imageheight", "usefisheyemodel", "distortionmodel")
"""What DV writes beside its cameras, for all of them."""
_MATRICES = ("cameramatrix", "intrinsicmatrix", "k")
_DISTORTIONS = ("distortioncoefficients", "distortioncoeffs", "distcoeffs", "distortion", "d")
_KS = ("k1", "k2", "k3", "k4")


def find_cameras(content: Any) -> dict[str, Intrinsics | InputError]:
    """Return the cameras of a file's content by their names, or why each cannot be used.

    Parameters
    ----------
    content : dict or list
        From `read_content`.

    Returns
    -------
    dict of str to Intrinsics or InputError
        In the order of the file; empty if it holds no camera.
    """
    if isinstance(content, list) and all(isinstance(line, list) for line in content):
        return {"camera": _tried(_from_lines, content)}
    found: dict[str, Intrinsics | InputError] = {}
    for names, read, node in _walk(content, (), {}):
        name = names[-1] if names else str(node.get("cameraname") or "camera")
        found["/".join(names) if name in found else name] = _tried(read, node)
    return found


def _tried(read: Callable[[Any], Intrinsics], node: Any) -> Intrinsics | InputError:
    try:
        return read(node)
    except InputError as error:
        return error


def _walk(
    content: Any, names: tuple[str, ...], above: Node
) -> Iterator[tuple[tuple[str, ...], Reader, Node]]:
    """Yield name, reader and content of each camera."""
    if len(names) > _DEEPEST or not isinstance(content, Mapping | list):
        return
    if isinstance(content, list):
        children, plain = [(str(k), value) for k, value in enumerate(content)], above
    else:
        children, plain = list(content.items()), plain_keys(content)
        node = {**{key: above[key] for key in _FOR_ALL if key in above}, **plain}
        for fits, read in _LAYOUTS:
            if fits(node):
                yield names, read, node
                return
        parts = _parts(plain)
        if parts is not None:
            children = parts
    for name, value in children:
        label = value.get("label") if isinstance(value, Mapping) else None
        yield from _walk(value, (*names, str(label or name)), plain)


def _parts(node: Node) -> list[tuple[str, Any]] | None:
    """Return the cameras of lists that tell sizes apart (Basalt), and of OpenCV's stereo files."""
    inside = node.get("intrinsics")
    if isinstance(inside, list) and any(
        "camera_type" in one for one in inside if isinstance(one, Mapping)
    ):
        sizes = node.get("resolution")
        told = (
            sizes if isinstance(sizes, list) and len(sizes) == len(inside) else [None] * len(inside)
        )
        return [
            (f"cam{k}", {**one, "resolution": size} if isinstance(one, Mapping) else one)
            for k, (one, size) in enumerate(zip(inside, told, strict=True))
        ]
    if {"m1", "d1", "m2", "d2"} <= node.keys():
        return [(f"cam{k}", {"k": node[f"m{k}"], "d": node[f"d{k}"]}) for k in (1, 2)]
    return None


def _from_lines(lines: list[list[float]]) -> Intrinsics:
    """Read ``fx fy cx cy k1 k2 p1 p2 [k3]``, or a 3 x 3 matrix; a last line of two is the size."""
    if [len(line) for line in lines[:3]] == [3, 3, 3]:
        return _from_matrix_lines(lines)
    size = None
    if len(lines) > 1 and len(lines[-1]) == 2:
        *lines, last = lines
        size = whole_size(last)
    values = [value for line in lines for value in line]
    if len(values) not in (4, 8, 9):
        raise InputError(
            f"it holds {len(values)} numbers; fx fy cx cy k1 k2 p1 p2 k3 are nine (k3, or all"
            " distortion, may be missing), and a line of width and height may follow"
        )
    return intrinsics(values[:4], values[4:], "radtan", size)


def _from_matrix_lines(lines: list[list[float]]) -> Intrinsics:
    """Read a matrix, and below it nothing, the distortion, or what dvs-panotracking writes."""
    focal = matrix([value for line in lines[:3] for value in line])
    rest = lines[3:]
    if [len(line) for line in rest] == [1, 1, 1]:
        width, height, k1 = (line[0] for line in rest)
        note = (
            f"below the camera matrix, {width:g} and {height:g} were taken for the size of a"
            f" panorama (not of the sensor), {k1:g} for k1; other coefficients are 0"
        )
        return intrinsics(focal, [k1, 0, 0, 0], "radtan", None, note)
    values = [value for line in rest for value in line]
    if len(values) not in (0, 4, 5):
        raise InputError(f"{len(values)} numbers follow its matrix; k1 k2 p1 p2 k3 are five")
    return intrinsics(focal, values, "radtan", None)


def _from_matrix(node: Node) -> Intrinsics:
    """Read ROS camera_info, OpenCV's files, DV's XML and Metavision's JSON."""
    focal = matrix(numbers(node, next(k for k in _MATRICES if k in node), "the camera matrix"))
    told = [word(node, key) for key in ("distortionmodel", "cameramodel")]
    model = next((one for one in told if one not in PLAIN), "")
    switches = [word(node, key) for key in ("usefisheyemodel", "fisheyemodel")]
    if not model and any(switch not in ("", "0", "false") for switch in switches):
        model = "fisheye"
    key = next((k for k in _DISTORTIONS if node.get(k) is not None), None)
    if key is None and model:
        raise InputError(f"it misses the coefficients of its distortion, {model}")
    given = [] if key is None else numbers(node, key, "the distortion")
    note = "it says nothing of distortion, and none was taken" if key is None else ""
    return intrinsics(focal, given, model, size_of(node), note)


def _from_chain(node: Node) -> Intrinsics:
    """Read Kalibr's and OpenVINS's camchains, and DSEC's cam_to_cam."""
    _only_pinhole(node)
    model = word(node, "distortionmodel")
    given: list[float] = []
    if model not in PLAIN:
        given = numbers(node, "distortioncoeffs", "distortion_coeffs")
    elif any(flat(node.get("distortioncoeffs"))):
        raise InputError("it has distortion_coeffs, but no distortion_model")
    key, label = ("cameramatrix", "camera_matrix"), ("intrinsics", "intrinsics")
    focal = numbers(node, *(label if "intrinsics" in node else key), 4)
    if "resolution" not in node:
        raise InputError("it misses resolution")
    return intrinsics(focal, given, model, size_of(node))


def _from_dv(node: Node) -> Intrinsics:
    """Read DV's JSON, in which numbers are texts."""
    focal = numbers(node, "focallength", "focalLength", 2)
    focal += numbers(node, "principalpoint", "principalPoint", 2)
    given = flat(node.get("distortioncoefficients")) and numbers(
        node, "distortioncoefficients", "distortionCoefficients"
    )
    return intrinsics(focal, given, word(node, "distortionmodel"), size_of(node))


def _from_basalt(node: Node) -> Intrinsics:
    """Read a camera of Basalt's JSON, as TUM-VIE's calibrations are."""
    model, values = word(node, "cameratype"), plain_keys(node["intrinsics"])
    names = {"kb4": _KS, "pinholeradtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")}
    given = named(values, *names.get(model, ()))
    return intrinsics(named(values, "fx", "fy", "cx", "cy"), given, model, size_of(node))


def _from_camodocal(node: Node) -> Intrinsics:
    """Read camodocal's and VINS's YAML."""
    model, values = word(node, "modeltype"), plain_keys(node["projectionparameters"])
    focal, given = list[float](), list[float]()
    if model == "kannalabrandt":
        focal, given = named(values, "mu", "mv", "u0", "v0"), named(values, "k2", "k3", "k4", "k5")
    elif model == "pinhole":
        focal = named(values, "fx", "fy", "cx", "cy")
        given = named(plain_keys(node.get("distortionparameters")), "k1", "k2", "p1", "p2")
    return intrinsics(focal, given, model, size_of(node))


def _from_vikit(node: Node) -> Intrinsics:
    """Read vikit's YAML."""
    model = {"pinholeequidistant": "equidistant"}.get(
        word(node, "cammodel"), word(node, "cammodel")
    )
    given = named(node, *(f"camd{k}" for k in range(4) if f"camd{k}" in node))
    return intrinsics(named(node, "camfx", "camfy", "camcx", "camcy"), given, model, size_of(node))


def _from_ikalibr(node: Node) -> Intrinsics:
    """Read iKalibr's YAML, whose Brown coefficients are k1 k2 k3 p1 p2."""
    model = word(node, "polymorphicname")
    data = plain_keys(plain_keys(node["ptrwrapper"]).get("data"))
    focal = numbers(data, "focallength", "focal_length", 2)
    focal += numbers(data, "principalpoint", "principal_point", 2)
    given = numbers(data, "distoparam", "disto_param")
    if model == "pinholebrownt2" and len(given) == 5:
        given = [given[k] for k in (0, 1, 3, 4, 2)]
    return intrinsics(focal, given, model, size_of(data))


def _from_orb_slam(node: Node) -> Intrinsics:
    """Read ORB-SLAM's YAML."""
    head = "camera1" if "camera1fx" in node else "camera"
    model = word(node, "cameratype")
    names = _KS if model == "kannalabrandt8" else ("k1", "k2", "p1", "p2", "k3")
    given = [number(node.get(head + name, 0), head + name) for name in names]
    focal = named(node, *(head + name for name in ("fx", "fy", "cx", "cy")))
    return intrinsics(focal, given, model, size_of(node))


def _from_svo(node: Node) -> Intrinsics:
    """Read a camera of SVO's list."""
    _only_pinhole({"cameramodel": node.get("type")})
    distortion = plain_keys(node["distortion"])
    given = (
        numbers(distortion, "parameters", "the distortion") if "parameters" in distortion else []
    )
    focal = numbers(node, "intrinsics", "intrinsics", 4)
    return intrinsics(focal, given, word(distortion, "type"), size_of(node))


def _only_pinhole(node: Node) -> None:
    kind = word(node, "cameramodel")
    if kind not in ("", "pinhole"):
        raise InputError(f"camera_model {kind!r} is not supported, only pinhole")


_LAYOUTS: tuple[tuple[Callable[[Node], bool], Reader], ...] = (
    (lambda n: {"polymorphicname", "ptrwrapper"} <= n.keys(), _from_ikalibr),
    (lambda n: {"modeltype", "projectionparameters"} <= n.keys(), _from_camodocal),
    (lambda n: {"cammodel", "camfx"} <= n.keys(), _from_vikit),
    (lambda n: not {"camerafx", "camera1fx"}.isdisjoint(n), _from_orb_slam),
    (lambda n: {"focallength", "principalpoint"} <= n.keys(), _from_dv),
    (lambda n: {"cameratype", "intrinsics"} <= n.keys(), _from_basalt),
    (lambda n: "intrinsics" in n and isinstance(n.get("distortion"), Mapping), _from_svo),
    (lambda n: {"cameramodel", "intrinsics"} <= n.keys(), _from_chain),
    (lambda n: "resolution" in n and len(flat(n.get("cameramatrix"))) == 4, _from_chain),
    (lambda n: any(len(flat(n.get(key))) >= 4 for key in _MATRICES), _from_matrix),
)
"""How each layout is known, and its reader; the first that fits is taken."""
