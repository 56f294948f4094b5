"""Which method identifies or names best, on flights whose truth is known? Synthetic flights as a product.

``scenario`` says what is drawn and ``kinds`` what is hidden, ``draws`` draws it, ``flying`` flies it, ``layout`` and
``store`` write it, ``datasheet`` describes it, ``open`` reads it, and ``score`` judges what others answer.
"""
