"""ROS bags without ROS, also those that were cut off."""

from data_tools.bags._bag import MAGIC, Bag, Topic, is_bag, open_bag
from evcalib._moved import leftovers

__all__ = ["MAGIC", "Bag", "Topic", "is_bag", "open_bag"]

__getattr__ = leftovers(__name__)
