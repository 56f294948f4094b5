"""Parts of all pages: tables, figures, words, style, HTML and terminal. Nothing here knows a question."""
