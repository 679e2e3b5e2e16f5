"""Channels: delay, loss, duplication and queues of messages on a link."""
