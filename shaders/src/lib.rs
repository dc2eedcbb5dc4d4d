//! Texfold's WGSL: decode functions to paste into a renderer, and the entry points that use them
