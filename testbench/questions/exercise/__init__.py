"""How do students learn system identification by experiment? Exercises, each student with a different aircraft.

An exercise is one module and one text in ``catalogue/``, and one line in :data:`.seal.NAMES`. A student gets a text,
records and a file for the answers, which is checked. TEACHING.md in this folder is for the teacher.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, start="ask", load_exercise="seal")
