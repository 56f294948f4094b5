"""What does the real autopilot do with this aircraft? Its own simulator flies it, before the day."""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, Served="ask", serve="links", sitl_page="page")
