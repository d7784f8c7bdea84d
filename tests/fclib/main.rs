//! Frictional contact problems of the FCLIB and Siconos collections (`tests/reference/fclib`: boxes, capsules,
//! spheres, rover wheels, finite elements; most with a singular Delassus operator). Each is solved from zero
//! impulses, until the error measure of the collections is small enough. Impulses are not compared: with a singular
//! operator they are not unique.

mod collection;
mod measure;
mod reference;
mod solved;
