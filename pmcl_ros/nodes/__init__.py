"""The only place that imports rclpy: thin lifecycle nodes over the core."""
