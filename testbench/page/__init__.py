"""What pages are made of: tables, figures, words, style, HTML and terminal. No question is known here."""
