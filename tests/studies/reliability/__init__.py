"""How the testbench bears damage: killed processes, damaged files, a full disk, crashes of JSBSim, very many runs."""
