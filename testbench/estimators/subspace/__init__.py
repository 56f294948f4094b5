"""Subspace identification: one state-space model from all inputs to all outputs, without iterations.

``family`` holds MOESP, N4SID, CVA, DSR, SSARX and PBSID-opt behind one function, ``dsr_e`` holds DSR_e.
"""
