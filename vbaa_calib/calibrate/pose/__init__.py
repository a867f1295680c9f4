"""The camera pose from boards: jig, actuator sweep, and their fusion."""
