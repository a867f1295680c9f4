"""`vbaa doctor`: is this installation healthy?"""
