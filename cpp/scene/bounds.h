// Boxes around runs of a large scene's primitives, for what each camera asks of all of them.
// Primitives are triangles, spheres and disks in this order. Answers are exact: they do not depend
// on the boxes.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace veriray {

// Around a primitive, in world coordinates.
Box box_around(const SceneInput& in, size_t primitive);
Box box_around(const SceneInput& in, ShapeGroup group, size_t row);

class SceneBounds {
   public:
    static constexpr size_t kRun = 256;  // primitives

    explicit SceneBounds(const SceneInput& in);

    const Box& all() const { return all_; }
    const std::vector<Box>& runs() const { return runs_; }
    // The least distance from a point to a primitive, by lower bounds: of flat ones the larger of
    // the distances to their plane and to their box.
    double nearest(const SceneInput& in, Double3 p) const;
    // Whether a primitive reaches a depth dot(q - from, axis) <= limit.
    bool reaches(const SceneInput& in, Double3 from, Double3 axis, double limit) const;

   private:
    // Calls visit(i) for primitives, but not for those of boxes with skip(box), until it returns
    // false.
    template <class Skip, class Visit>
    bool each(Skip skip, Visit visit) const;

    size_t count_ = 0;
    std::vector<Box> runs_, groups_;  // groups: of runs
    Box all_;
};

}  // namespace veriray
