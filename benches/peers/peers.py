"""Cuts, box differences and Poisson-disk samplings of VTK, MeshLib and manifold, for benches/peers/run.

    peers.py cut MODEL.obj ... | boxes MODEL.obj BOXES.obj | poisson

Prints medians in milliseconds. Loading and copies of the input are not timed.
"""

import sys
import time

import manifold3d
import meshlib.mrmeshnumpy as mrn
import meshlib.mrmeshpy as mr
import numpy as np
import vtk
from vtk.util import numpy_support

NORMAL, OFFSET = np.array([0.3, 1.0, 0.2]), 0.001


def median(times):
    return sorted(times)[len(times) // 2]


def ms(work):
    start = time.perf_counter()
    result = work()
    return (time.perf_counter() - start) * 1e3, result


def row(faces, name, times):
    print(f"{faces:8d} faces  {name} {median(times):10.3f} ms", flush=True)


def read(path):
    """Vertices, and the triangles of each object of an OBJ file."""
    points, objects = [], [[]]
    with open(path) as file:
        for words in map(str.split, file):
            if words[:1] == ["v"]:
                points.append([float(x) for x in words[1:4]])
            elif words[:1] == ["o"] and objects[-1]:
                objects.append([])
            elif words[:1] == ["f"]:
                corners = [int(w.split("/")[0]) - 1 for w in words[1:]]
                objects[-1] += [[corners[0], b, c] for b, c in zip(corners[1:], corners[2:])]
    return np.array(points), [np.array(o, dtype=np.int32) for o in objects if o]


def to_vtk(points, triangles):
    data, vertices, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    vertices.SetData(numpy_support.numpy_to_vtk(points, deep=True))
    cells.SetData(3, numpy_support.numpy_to_vtkIdTypeArray(triangles.astype(np.int64).ravel(), deep=True))
    data.SetPoints(vertices)
    data.SetPolys(cells)
    return data


def to_manifold(points, triangles):
    mesh = manifold3d.Mesh64(vert_properties=points, tri_verts=triangles.astype(np.uint64))
    return manifold3d.Manifold(mesh)


def to_meshlib(points, triangles):
    return mrn.meshFromFacesVerts(triangles, points.astype(np.float32))


def vtk_clip(data):
    pieces = []
    for side in (1, -1):
        plane, planes, clip = vtk.vtkPlane(), vtk.vtkPlaneCollection(), vtk.vtkClipClosedSurface()
        plane.SetNormal(*(side * NORMAL))
        plane.SetOrigin(*(OFFSET * NORMAL / NORMAL.dot(NORMAL)))
        planes.AddItem(plane)
        clip.SetInputData(data)
        clip.SetClippingPlanes(planes)
        clip.Update()
        pieces.append(clip.GetOutput())
    return pieces


def vtk_open(data):
    plane, clip = vtk.vtkPlane(), vtk.vtkClipPolyData()
    plane.SetNormal(*NORMAL)
    plane.SetOrigin(*(OFFSET * NORMAL / NORMAL.dot(NORMAL)))
    clip.SetInputData(data)
    clip.SetClipFunction(plane)
    clip.GenerateClippedOutputOn()
    clip.Update()


def meshlib_trim(meshes, closed):
    for side, mesh in zip((1, -1), meshes):
        parameters = mr.TrimWithPlaneParams()
        normal = mr.Vector3f(*(side * NORMAL).tolist())
        parameters.plane = mr.Plane3f(normal, side * OFFSET).normalized()
        mr.trimWithPlane(mesh, parameters)
        if closed:
            mr.fillContours2D(mesh, mesh.topology.findHoleRepresentiveEdges())


def cut(path):
    points, objects = read(path)
    triangles = objects[0]
    faces = len(triangles)
    rounds = min(max(200_000 // faces, 3), 41)
    data, solid, mesh = to_vtk(points, triangles), to_manifold(points, triangles), to_meshlib(points, triangles)
    row(faces, "VTK vtkClipPolyData, two open pieces", [ms(lambda: vtk_open(data))[0] for _ in range(rounds)])
    row(faces, "VTK vtkClipClosedSurface, two closed pieces", [ms(lambda: vtk_clip(data))[0] for _ in range(rounds)])

    def split():
        return [piece.num_tri() for piece in solid.split_by_plane(NORMAL, OFFSET / np.linalg.norm(NORMAL))]

    row(faces, "manifold split_by_plane, two closed pieces", [ms(split)[0] for _ in range(rounds)])
    for closed in (False, True):
        times = []
        for _ in range(rounds):
            copies = [mr.copyMesh(mesh) for _ in range(2)]
            times.append(ms(lambda: meshlib_trim(copies, closed))[0])
        kind = "and fillContours2D, two closed pieces" if closed else "two open pieces"
        row(faces, f"MeshLib trimWithPlane, {kind}", times)


def boxes(model, path):
    points, objects = read(model)
    faces = len(objects[0])
    corners, hulls = read(path)
    hulls = hulls[: 3 if faces > 500_000 else 20]
    parts = []
    for hull in hulls:
        used, own = np.unique(hull.ravel(), return_inverse=True)
        parts.append((corners[used], own.reshape(-1, 3).astype(np.int32)))
    whole, times = to_manifold(points, objects[0]), []
    for part in parts:
        box = to_manifold(*part)

        def difference():
            result = whole - box
            result.num_tri()
            return result

        taken, whole = ms(difference)
        times.append(taken)
    row(faces, f"manifold difference with one box (of {len(times)})", times)
    whole, times = to_meshlib(points, objects[0]), []
    for part in parts:
        box = to_meshlib(*part)
        taken, result = ms(lambda: mr.boolean(whole, box, mr.BooleanOperation.DifferenceAB))
        if result.valid():
            whole = result.mesh
            times.append(taken)
    row(faces, f"MeshLib difference with one box (of {len(times)})", times or [float("nan")])


def poisson():
    for rings, wanted, rounds in ((72, 190, 40), (1000, 20_000, 5)):
        source = vtk.vtkSphereSource()
        source.SetThetaResolution(rings)
        source.SetPhiResolution(rings)
        source.Update()
        data = source.GetOutput()
        radius = np.sqrt(np.pi / wanted * 0.7)

        def sample():
            sampler = vtk.vtkPoissonDiskSampler()
            sampler.SetInputData(data)
            sampler.SetRadius(radius)
            sampler.Update()
            return sampler.GetOutput().GetNumberOfPoints()

        for _ in range(3):
            radius *= np.sqrt(sample() / wanted)
        vertices = data.GetNumberOfPoints()
        times = [ms(sample) for _ in range(rounds)]
        print(f"{vertices:8d} vertices  VTK vtkPoissonDiskSampler, {times[0][1]} samples {median([t for t, _ in times]):10.3f} ms", flush=True)


if __name__ == "__main__":
    what, *files = sys.argv[1:]
    if what == "cut":
        for file in files:
            cut(file)
    elif what == "boxes":
        boxes(*files)
    else:
        poisson()
