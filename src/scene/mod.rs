//! What a user describes.
