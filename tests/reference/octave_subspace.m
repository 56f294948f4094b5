% SLICOT's moen4 and n4sid, as the control package of GNU Octave calls them, on the data of octave_subspace.py.
% Usage: octave-cli octave_subspace.m FOLDER, which holds NAME.csv (inputs first) and cases.csv; writes NAME_METHOD.csv
% with the poles z, real and imaginary part per line.
pkg load control
folder = argv (){1};
lines = strsplit (strtrim (fileread (fullfile (folder, "cases.csv"))), "\n");
for i = 1:numel (lines)
  parts = strsplit (lines{i}, ",");
  [name, m, order, horizon] = deal (parts{1}, str2double (parts{2}), str2double (parts{3}), str2double (parts{4}));
  z = csvread (fullfile (folder, [name ".csv"]));
  data = iddata (z(:, m+1:end), z(:, 1:m), 1);
  for method = {"moen4", "n4sid"}
    sys = feval (method{1}, data, "n", order, "s", horizon, "alg", "qr");
    z_poles = eig (sys.a);
    fid = fopen (fullfile (folder, [name "_" method{1} ".csv"]), "w");
    fprintf (fid, "%.17g,%.17g\n", [real(z_poles) imag(z_poles)]');
    fclose (fid);
  endfor
endfor
