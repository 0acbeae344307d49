"""How this package's values lie in ROS messages, by kind; used through `pmcl_ros.conversions`."""
