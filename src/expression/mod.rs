//! Infix text to evaluable code with exact derivatives.
