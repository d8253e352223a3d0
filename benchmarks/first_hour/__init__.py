"""The first hour of different users: their commands as the documentation gives them, what they print, and their time."""
