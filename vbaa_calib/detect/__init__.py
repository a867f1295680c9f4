"""What a picture shows: corners of boards, the antenna's centreline, and what is wrong with the picture."""
