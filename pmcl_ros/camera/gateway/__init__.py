"""Gateway: a camera behind another machine, for robots that cannot join its Wi-Fi."""
