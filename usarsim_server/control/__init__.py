"""World controllers and avatars: connections that have no robot."""
