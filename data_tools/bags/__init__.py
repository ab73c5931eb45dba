"""ROS bags without ROS, also those that were cut off."""

from data_tools.bags._bag import DEFINITIONS, MAGIC, Bag, Topic, is_bag, open_bag

__all__ = [
    "DEFINITIONS",
    "MAGIC",
    "Bag",
    "Topic",
    "is_bag",
    "open_bag",
]
