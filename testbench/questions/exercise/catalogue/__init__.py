"""One module and one text per exercise; the modules are named in ``testbench.questions.exercise.seal.NAMES``."""
