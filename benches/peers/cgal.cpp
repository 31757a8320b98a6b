// The cuts and the box differences of CGAL, for benches/peers/run: `cgal cut MODEL.obj ...`, `cgal boxes MODEL.obj BOXES.obj`.
// Prints medians in milliseconds. Copies of the input are not timed.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/clip.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/refine_with_plane.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Surface_mesh.h>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace PMP = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Triangles = std::vector<std::array<std::size_t, 3>>;

static double median(std::vector<double> times) {
    std::sort(times.begin(), times.end());
    return times.empty() ? 0.0 : times[times.size() / 2];
}

template <typename Work> static double ms(Work work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

static Mesh mesh_of(const std::vector<Kernel::Point_3>& points, const Triangles& triangles) {
    Mesh mesh;
    PMP::polygon_soup_to_polygon_mesh(points, triangles, mesh);
    return mesh;
}

// Vertices and the triangles of each object ("o" line) of a file.
static void read(const char* path, std::vector<Kernel::Point_3>& points, std::vector<Triangles>& objects) {
    std::ifstream file(path);
    std::string line, word;
    objects.emplace_back();
    while (std::getline(file, line)) {
        std::istringstream words(line);
        words >> word;
        if (word == "v") {
            double x, y, z;
            words >> x >> y >> z;
            points.emplace_back(x, y, z);
        } else if (word == "o" && !objects.back().empty()) {
            objects.emplace_back();
        } else if (word == "f") {
            std::vector<std::size_t> corners;
            while (words >> word) corners.push_back(std::stoul(word) - 1);
            for (std::size_t k = 2; k < corners.size(); ++k) objects.back().push_back({corners[0], corners[k - 1], corners[k]});
        }
    }
}

static Mesh load(const char* path) {
    std::vector<Kernel::Point_3> points;
    std::vector<Triangles> objects;
    read(path, points, objects);
    return mesh_of(points, objects.front());
}

static void cut(const char* path) {
    const Mesh model = load(path);
    const int faces = static_cast<int>(model.number_of_faces()), rounds = std::clamp(200000 / faces, 3, 41);
    // the plane of benches/cut.rs, whose models are exported about their middle
    const Kernel::Plane_3 plane(0.3, 1.0, 0.2, -0.001), other = plane.opposite();
    std::vector<double> refine, split, closed;
    for (int round = 0; round < rounds; ++round) {
        Mesh a = model, b = model, c = model, d = model;
        refine.push_back(ms([&] { PMP::refine_with_plane(a, plane); }));
        split.push_back(ms([&] { PMP::split(b, plane); }));
        closed.push_back(ms([&] {
            PMP::clip(c, plane, CGAL::parameters::clip_volume(true));
            PMP::clip(d, other, CGAL::parameters::clip_volume(true));
        }));
    }
    std::printf("%8d faces  CGAL refine_with_plane (edges on the plane, nothing parted) %10.3f ms\n", faces, median(refine));
    std::printf("%8d faces  CGAL split, in place %10.3f ms\n", faces, median(split));
    std::printf("%8d faces  CGAL clip with volume, two closed pieces %10.3f ms\n", faces, median(closed));
}

static void boxes(const char* model, const char* path) {
    const Mesh whole = load(model);
    const int faces = static_cast<int>(whole.number_of_faces());
    std::vector<Kernel::Point_3> points;
    std::vector<Triangles> objects;
    read(path, points, objects);
    std::vector<double> times;
    for (const Triangles& triangles : objects) {
        std::vector<Kernel::Point_3> corners;
        Triangles own;
        for (const auto& t : triangles) {
            own.push_back({corners.size(), corners.size() + 1, corners.size() + 2});
            for (std::size_t v : t) corners.push_back(points[v]);
        }
        PMP::merge_duplicate_points_in_polygon_soup(corners, own);
        Mesh box = mesh_of(corners, own);
        if (!CGAL::is_closed(box)) continue;
        if (!PMP::is_outward_oriented(box)) PMP::reverse_face_orientations(box);
        // Each from the model as it was: boxes of a chain share a face, whose rounded corners in the result so far stop CGAL.
        Mesh torn = whole;
        bool done = false;
        const double time = ms([&] { done = PMP::corefine_and_compute_difference(torn, box, torn); });
        if (done) times.push_back(time);
        if (times.size() >= (faces > 500000 ? 3u : 20u)) break;
    }
    std::printf("%8d faces  CGAL difference with one box (of %zu) %10.3f ms\n", faces, times.size(), median(times));
}

int main(int count, char** arguments) {
    const std::string what = count > 1 ? arguments[1] : "";
    for (int k = 2; what == "cut" && k < count; ++k) cut(arguments[k]);
    if (what == "boxes" && count == 4) boxes(arguments[2], arguments[3]);
    return 0;
}
