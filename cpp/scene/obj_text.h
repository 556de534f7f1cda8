// The lines of a Wavefront OBJ file that hold numbers.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

namespace veriray {

struct ObjTables {
    std::vector<double> lines[3];  // numbers of the lines v (3 each), vt (2) and vn (3)
    std::vector<int64_t> corners;  // of all faces: rows of v, vt and vn, from 0; -1 for none
    std::vector<int64_t> sides;    // corners of each face
};

// Reads a text without continued lines. An absent number of a vt is 0; a corner without a vt or vn
// has that of the corner before it in its face. False, with tables that are not complete, if a line
// does not follow the format, or holds a number beyond those of float64.
bool read_obj(std::string_view text, ObjTables& out);

}  // namespace veriray
