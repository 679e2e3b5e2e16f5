"""Spatio-temporal goals of drones: control barrier functions from STL tasks, agreed on by messages."""

from symaware_drones.barrier import Barrier, BarrierSample
from symaware_drones.schedule import Schedule, ScheduledTask
from symaware_drones.task import Task, tasks_of

__all__ = ["Barrier", "BarrierSample", "Schedule", "ScheduledTask", "Task", "tasks_of"]
