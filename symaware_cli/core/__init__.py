"""The vocabulary: time, awareness, knowledge, agent, component, entity, model, environment, message, event."""

from symaware_cli.core.agent import Agent, AgentGroup, Surroundings
from symaware_cli.core.awareness import AwarenessVector, GroupAwareness, Observation
from symaware_cli.core.awareness_database import AwarenessDatabase
from symaware_cli.core.chance import Turn, generator
from symaware_cli.core.component import (
    CommunicationReceiver,
    CommunicationSender,
    Component,
    Controller,
    GroupCommunicationReceiver,
    GroupComponent,
    PerceptionSystem,
    RiskEstimator,
    UncertaintyEstimator,
)
from symaware_cli.core.entity import Entity, Obstacle
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.core.environment import Environment, EnvironmentParameters, WorldError
from symaware_cli.core.event import Event, EventBus, Level, SubscriberError, Subscription
from symaware_cli.core.knowledge import KnowledgeDatabase
from symaware_cli.core.links import Links
from symaware_cli.core.message import EVERYBODY, Delivery, Exchange, Message, MessageBatch
from symaware_cli.core.model import Model, Quantity
from symaware_cli.core.part import PARTS, Part
from symaware_cli.core.plugin import Parameters, Plugin
from symaware_cli.core.reading import Frame, Image, Measurement, Reading, Scan
from symaware_cli.core.refusal import Attempts, RefusalError
from symaware_cli.core.series import TimeSeries
from symaware_cli.core.time import Clock, nanoseconds, seconds
from symaware_cli.core.tracks import Tracks
from symaware_cli.core.world import Contact, Roster, Snapshot
from symaware_cli.geometry.path import Pose, ScriptedPath
from symaware_cli.geometry.scenery import Scenery
from symaware_cli.geometry.shape import Box, Circle, Cylinder, Mesh, Polygon, Shape, Urdf, Wall

__all__ = [
    "EVERYBODY",
    "PARTS",
    "Agent",
    "AgentGroup",
    "Attempts",
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
    "Entity",
    "EntityGroup",
    "Environment",
    "EnvironmentParameters",
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
    "Measurement",
    "Mesh",
    "Message",
    "MessageBatch",
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
    "RefusalError",
    "RiskEstimator",
    "Roster",
    "Scan",
    "Scenery",
    "ScriptedPath",
    "Shape",
    "Snapshot",
    "SubscriberError",
    "Subscription",
    "Surroundings",
    "TimeSeries",
    "Tracks",
    "Turn",
    "UncertaintyEstimator",
    "Urdf",
    "Wall",
    "WorldError",
    "generator",
    "nanoseconds",
    "seconds",
]
