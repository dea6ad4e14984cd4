"""Print what a run publishes to ROS 2, without ROS: `tactophone loopback --bridge ros`,
then `follow_ros.py`."""

import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tactophone.faces.bridges import ros_topics as messages

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
domain = DomainParticipant(0)
reader = DataReader(
    domain, Topic(domain, "rt/tactophone/index/vibration", messages.Float32MultiArray)
)
until = time.monotonic() + seconds
while time.monotonic() < until:
    for sample in reader.take(N=10):
        amplitude, frequency = sample.data
        print(f"amplitude {amplitude:.2f}, {frequency:.0f} Hz")
    time.sleep(0.01)
