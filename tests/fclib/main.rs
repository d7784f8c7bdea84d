//! Frictional contact problems of the FCLIB and Siconos collections (`tests/reference/fclib`: boxes, capsules, spheres,
//! rover wheels, finite elements; most with a singular Delassus operator), each solved from rest to the error measure
//! of those collections. Impulses are not compared: where the operator is singular they are not unique.

mod collection;
mod measure;
mod reference;
mod solved;
