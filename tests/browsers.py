"""A browser that tests may open pages in, where there is one."""

import shutil

DRIVER = shutil.which("chromedriver")
NO_BROWSER = "there is no chromedriver: no page is looked at in a browser"
