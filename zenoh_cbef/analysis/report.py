"""stub"""


def write_report(analysis, path):
    path.write_text("")
