"""ROS 2 over DDS, without a ROS installation; needs the extra ``ros``."""

from tactophone.bridges.ros.bridge import RosBridge
from tactophone.bridges.ros.sinks import Sink, open_sink

__all__ = ["RosBridge", "Sink", "open_sink"]
