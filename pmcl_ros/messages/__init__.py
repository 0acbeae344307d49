"""The layouts of this package's values in ROS messages: one module a message, without rclpy.

Writers take an optional `Buffer`, the publisher's own, and fill it in place: the message that they
return holds until the next is written to the same buffer. Readers check all that a topic promises,
raise MessageError with what is wrong, the values and the remedy, and never copy big fields.
"""
