"""Events and images to corners, keypoints, descriptors and displacements."""

from evcalib._moved import leftovers
from evcalib.features._event_image import LAST, EventImage, EventImager, align_patches
from evcalib.features._keypoints import KeypointFinder, Keypoints, brief_pattern, match

__all__ = [
    "LAST",
    "EventImage",
    "EventImager",
    "KeypointFinder",
    "Keypoints",
    "align_patches",
    "brief_pattern",
    "match",
]

__getattr__ = leftovers(__name__)
