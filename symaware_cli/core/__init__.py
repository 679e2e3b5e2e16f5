"""The vocabulary of plugins: agents, components, environments, messages, events, and the types that they consist of."""

from symaware_cli.awareness.awareness import AwarenessVector, GroupAwareness, Observation
from symaware_cli.awareness.database import AwarenessDatabase
from symaware_cli.awareness.knowledge import KnowledgeDatabase
from symaware_cli.awareness.part import PARTS, Part
from symaware_cli.awareness.signal import Signal
from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.awareness.tracks import Tracks
from symaware_cli.core.agent import Agent, AgentGroup, Surroundings
from symaware_cli.core.component import Component, GroupCommunicationReceiver, GroupComponent
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.core.environment import Environment, EnvironmentParameters, WorldError
from symaware_cli.core.event import Event, EventBus, Level, SubscriberError, Subscription
from symaware_cli.core.families import (
    CommunicationReceiver,
    CommunicationSender,
    Controller,
    PerceptionSystem,
    RiskEstimator,
    UncertaintyEstimator,
)
from symaware_cli.core.links import Links
from symaware_cli.core.message import EVERYBODY, Delivery, Exchange, Message, MessageBatch
from symaware_cli.core.metric import Metric
from symaware_cli.geometry.path import Pose, ScriptedPath
from symaware_cli.geometry.scenery import Scenery
from symaware_cli.geometry.shape import Box, Circle, Cylinder, Mesh, Polygon, Shape, Urdf, Wall
from symaware_cli.world.chance import Turn, generator
from symaware_cli.world.contact import Contact
from symaware_cli.world.drive import Drive
from symaware_cli.world.entity import Entity, Obstacle
from symaware_cli.world.model import Model, Quantity
from symaware_cli.world.plugin import Parameters, Plugin
from symaware_cli.world.reading import Frame, Image, Reading, Scan
from symaware_cli.world.roster import Roster
from symaware_cli.world.snapshot import Snapshot
from symaware_cli.world.time import Clock, nanoseconds, seconds
from symaware_cli.world.unsupported import ErrorCollector, UnsupportedError

__all__ = [
    "EVERYBODY",
    "PARTS",
    "Agent",
    "AgentGroup",
    "AwarenessDatabase",
    "AwarenessVector",
    "Box",
    "Circle",
    "Clock",
    "CommunicationReceiver",
    "CommunicationSender",
    "Component",
    "Contact",
    "Controller",
    "Cylinder",
    "Delivery",
    "Drive",
    "Entity",
    "EntityGroup",
    "Environment",
    "EnvironmentParameters",
    "ErrorCollector",
    "Event",
    "EventBus",
    "Exchange",
    "Frame",
    "GroupAwareness",
    "GroupCommunicationReceiver",
    "GroupComponent",
    "Image",
    "KnowledgeDatabase",
    "Level",
    "Links",
    "Mesh",
    "Message",
    "MessageBatch",
    "Metric",
    "Model",
    "Observation",
    "Obstacle",
    "Parameters",
    "Part",
    "PerceptionSystem",
    "Plugin",
    "Polygon",
    "Pose",
    "Quantity",
    "Reading",
    "RiskEstimator",
    "Roster",
    "Scan",
    "Scenery",
    "ScriptedPath",
    "Shape",
    "Signal",
    "Snapshot",
    "SubscriberError",
    "Subscription",
    "Surroundings",
    "TimeSeries",
    "Tracks",
    "Turn",
    "UncertaintyEstimator",
    "UnsupportedError",
    "Urdf",
    "Wall",
    "WorldError",
    "generator",
    "nanoseconds",
    "seconds",
]
