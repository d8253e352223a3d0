"""`companion ros2`: publishes the streams of the service to ROS 2 through Zenoh, without a ROS installation."""
