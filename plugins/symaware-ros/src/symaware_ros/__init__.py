"""Control of agents by nodes of ROS 2 over a rosbridge: in lock-step, so that a run is repeatable, or paced."""
