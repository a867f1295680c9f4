"""Forward mechanics of the antenna: loads in, shapes out."""
