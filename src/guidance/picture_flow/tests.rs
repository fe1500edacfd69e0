//! What must hold on made-up pictures.

