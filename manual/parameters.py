import griffe
class Extension(griffe.Extension):
    pass
