"""The Gymnasium face: tasks, observations, rewards, the single env and the native batch."""
