// Bodies that faces are of, for the order of faces in one plane (touching.cpp).
#pragma once

#include <cmath>
#include <map>
#include <vector>

#include "scene/scene.h"

namespace veriray {

// The faces of one surface; sheets, if all have one normal.
struct Body {
    Box box;
    bool clear;  // lets light through
    Double3 n;
    bool sheets = true;

    double size() const { return length(box.high - box.low); }
};

class Bodies {
   public:
    // The largest difference of normals of planes that touch; others are that near only along a
    // line.
    static constexpr double kParallel = 0x1p-10;

    // The next face.
    void add(const PrimitiveSource& s, const Box& box, Double3 n, bool clear) {
        const SurfaceKey key{s.material, s.emission, s.boundary};
        if (body_.empty() || key != last_)
            body_.push_back(&bodies_.try_emplace(key, Body{box, clear, n}).first->second);
        else
            body_.push_back(body_.back());
        last_ = key;
        Body& b = *body_.back();
        b.box = around(b.box, box);
        b.sheets = b.sheets && !(length(cross(n, b.n)) > kParallel);
    }

    const std::map<SurfaceKey, Body>& all() const { return bodies_; }
    const Body& of(uint32_t face) const { return *body_[face]; }

    // Whether the body of face b counts as within that of face a, if they have faces in one plane:
    // the smaller within the larger, of equal ones the later within the earlier, none within
    // sheets.
    bool holds(uint32_t a, uint32_t b) const {
        if (of(a).sheets != of(b).sheets) return of(a).sheets;
        const double size = of(a).size(), more = size - of(b).size();
        return std::abs(more) > kSameSize * size ? more > 0 : a < b;
    }

   private:
    // The largest relative difference in size of bodies that count as equal.
    static constexpr double kSameSize = 1e-6;

    std::map<SurfaceKey, Body> bodies_;
    std::vector<Body*> body_;  // by face
    SurfaceKey last_{};
};

}  // namespace veriray
