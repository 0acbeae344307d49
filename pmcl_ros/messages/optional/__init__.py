"""Messages whose packages may be missing: their classes are asked for by name, when they are made.

classes: a function `PACKAGE/msg/KIND` -> its class, as `types.message_class` of ROS, or the types
of a store of rosbags. Every field is given: classes of rosbags have no defaults.
"""
