"""Which method identifies or names best, on flights with known truth? Synthetic flights as a product.

``scenario`` states what is drawn and ``kinds`` what is hidden, ``draws`` draws it, ``flying`` flies it, ``layout`` and
``store`` write it, ``datasheet`` describes it, ``open`` reads it, and ``score`` judges answers.
"""
