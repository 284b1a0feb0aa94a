"""Appearance of the machines: framing, light, shadows and visible parts, none of which affect the digest."""

import itertools
import math

import mujoco
import numpy as np
import pytest

from gantrysim import Machine, perfect_follower
from gantrysim.machine.machine import builtin_models
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints
from gantrysim.render import Renderer
from gantrysim.render.opengl import offscreen_context

from support.runs import ends_of_travel
from support.soaked import suite_runs

CAMERAS = ("overview", "top", "nozzle", "side")
SIZE = (640, 480)
DRIVES = {"xy": "xy", "xyz": "xyz", "xyzr": "xyzr", "stage": ("x", "y", "th"), "delta": ("a1", "a2", "a3", "r")}
PARTS = {
    "xy": ("x_screw", "y_screw", "x_rail", "y_rail", "carriage", "beam", "x_duct", "y_duct", "gauge", "stop"),
    "xyz": ("x_screw", "y_screw", "z_screw", "x_rail", "y_rail", "carriage", "beam", "x_duct", "y_duct", "gauge"),
    "xyzr": ("x_screw", "y_screw", "z_screw", "x_rail", "y_rail", "carriage", "beam", "r_belt", "gauge", "stop"),
    "delta": ("base", "platform", "a1_gear", "a1_arm", "a2_arm", "a3_arm", "column", "gauge", "stop"),
    "stage": ("x_screw", "y_screw", "x_rail", "y_rail", "column", "gauge", "stop"),
}
SEEN = 12  # pixels of a part, in at least one of the cameras


class Studio:
    """Pictures of a bare machine."""

    def __init__(self, machine):
        self.machine, self.model = machine, machine.model
        self.data = mujoco.MjData(self.model)
        self.gl = offscreen_context(*SIZE)
        self.context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self.context)
        self.scene = mujoco.MjvScene(self.model, maxgeom=1000)

    def close(self):
        self.gl.make_current()
        self.context.free()
        self.gl.free()

    def place(self, position):
        self.data.qpos[:] = self.machine.to_qpos(position)
        mujoco.mj_forward(self.model, self.data)

    def picture(self, camera, **flags):
        """The picture, (height, width, 3); flags of mjtRndFlag are set or cleared."""
        self.gl.make_current()
        view = mujoco.MjvCamera()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.model.camera(camera).id
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, self.data, mujoco.MjvOption(), None, view, everything, self.scene)
        usual = self.scene.flags.copy()
        for name, value in flags.items():
            self.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{name}")] = value
        rectangle = mujoco.MjrRect(0, 0, *SIZE)
        mujoco.mjr_render(rectangle, self.scene, self.context)
        self.scene.flags[:] = usual
        image = np.empty((SIZE[1], SIZE[0], 3), np.uint8)
        mujoco.mjr_readPixels(image, None, rectangle, self.context)
        return image[::-1].astype(int)

    def pixels(self, camera):
        """How many pixels of the picture each geom owns, by its name."""
        drawn = self.picture(camera, SEGMENT=1, IDCOLOR=1)
        number = drawn[..., 0] + 256 * drawn[..., 1] + 65536 * drawn[..., 2] - 1
        owned = np.bincount(number[number >= 0], minlength=self.scene.ngeom)
        found = {}
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and 0 <= geom.segid < len(owned):
                found[self.model.geom(geom.objid).name] = int(owned[geom.segid])
        return found


# a robot and a gantry
@pytest.fixture(scope="module", params=suite_runs(builtin_models(), 0, 3))
def studio(request):
    studio = Studio(Machine(request.param))
    studio.place(np.zeros(len(studio.machine.axes)))
    yield studio
    studio.close()


def seen_by(studio, camera, points):
    """Where points [m] appear, right and down from the middle, in halves of width and height at 4:3, (n, 2)."""
    k = studio.model.camera(camera).id
    local = (points - studio.data.cam_xpos[k]) @ studio.data.cam_xmat[k].reshape(3, 3)
    assert (local[:, 2] < 0).all()
    tangent = math.tan(0.5 * math.radians(studio.model.cam_fovy[k]))
    return np.stack([local[:, 0] * 3 / 4, -local[:, 1]], axis=1) / (-local[:, 2:] * tangent)


def corners(studio):
    """Corners of the boxes round all shapes but the floor [m]."""
    model, data = studio.model, studio.data
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    shapes = [g for g in range(model.ngeom) if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    local = model.geom_aabb[shapes, None, :3] + signs * model.geom_aabb[shapes, None, 3:]
    turned = np.einsum("gij,gcj->gci", data.geom_xmat[shapes].reshape(-1, 3, 3), local)
    return (data.geom_xpos[shapes][:, None] + turned).reshape(-1, 3)


def everywhere(studio):
    """All corners of the travel, in turn."""
    for position in ends_of_travel(studio.machine):
        studio.place(position)
        yield position
    studio.place(np.zeros(len(studio.machine.axes)))


def test_the_machine_fills_the_overview_and_stays_inside_it(studio):
    reach = np.zeros((2, 2))  # least and largest, right and down
    for _ in everywhere(studio):
        where = seen_by(studio, "overview", corners(studio))
        reach = np.stack([np.minimum(reach[0], where.min(axis=0)), np.maximum(reach[1], where.max(axis=0))])
    assert np.abs(reach).max() < 1
    # on at least one pair of edges there is no room left, and the machine is in the middle of the others
    assert np.ptp(reach, axis=0).max() > 1.9
    assert np.abs(reach.sum(axis=0)).max() < 0.1


def test_the_nozzle_is_near_the_middle_of_its_camera(studio):
    random = np.random.default_rng(0)
    low, high = np.array([axis.travel for axis in studio.machine.axes]).T
    for position in random.uniform(low, high, (20, len(low))):
        studio.place(position)
        ((right, down),) = seen_by(studio, "nozzle", studio.data.site_xpos[studio.machine.nozzle][None])
        assert abs(right) < 0.1
        assert 0 < down < 0.45  # a little low, so that needle and hub are visible above it
    studio.place(np.zeros(len(low)))
    assert studio.pixels("nozzle")["needle"] > 200


def test_the_key_lights_cone_just_holds_the_machine(studio):
    model = studio.model
    shadows = [k for k in range(model.nlight) if model.light_castshadow[k]]
    assert [model.light(k).name for k in shadows] == ["key"]
    half = math.radians(model.light_cutoff[shadows[0]] * model.vis.map.shadowscale)
    widest = 0.0
    for _ in everywhere(studio):
        rays = corners(studio) - studio.data.light_xpos[shadows[0]]
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        widest = max(widest, float(np.arccos(rays @ studio.data.light_xdir[shadows[0]]).max()))
    assert 0.9 * half < widest < half


@pytest.mark.parametrize("camera", CAMERAS)
def test_pictures_are_neither_black_nor_blown_out(studio, camera):
    picture = studio.picture(camera)
    assert (40 if camera == "nozzle" else 80) < picture.mean() < 190  # from near there is little but a dark work piece
    assert picture.std() > (8 if camera == "nozzle" else 30)
    assert (picture.max(axis=2) < 6).mean() < 0.05
    assert (picture.min(axis=2) > 250).mean() < 0.005
    # the glue's colour is the machines' own nowhere but in the syringe, so that a bead stands out
    red, green, blue = np.moveaxis(picture, 2, 0)
    assert ((red > 200) & (green > 100) & (green < 190) & (blue < 60)).mean() < 0.01


def test_shadows_are_cast(studio):
    lit, flat = studio.picture("overview"), studio.picture("overview", SHADOW=0)
    darker = (flat - lit).max(axis=2) > 20
    assert 0.03 < darker.mean() < 0.4
    assert ((lit - flat).max(axis=2) > 20).mean() < 1e-3  # and no light that was not there


def test_the_parts_of_a_dispenser_are_seen(studio):
    name = studio.machine.name
    seen = [studio.pixels(camera) for camera in CAMERAS]
    for part in (*(f"{axis}_motor" for axis in DRIVES[name]), *PARTS[name], "needle", "hub", "syringe", "piece"):
        assert max(owned.get(part, 0) for owned in seen) >= SEEN, part
    # most geoms are visible in some camera
    drawn = sum(studio.model.geom_group < 3)
    assert drawn > 100


def test_every_motor_and_every_slides_screw_is_drawn(studio):
    for axis in studio.machine.axes:
        assert studio.model.geom(f"{axis.name}_motor").id >= 0
        if axis.unit == "mm":
            assert studio.model.geom(f"{axis.name}_screw").id >= 0


def test_the_threads_have_the_leads_of_the_screws(studio):
    model = studio.model
    for a, axis in enumerate(studio.machine.axes):
        if axis.unit == "mm":
            mesh = int(model.geom_dataid[model.geom(f"{axis.name}_screw").id])
            count = int(model.mesh_vertnum[mesh])
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][:count]
            turns = model.mesh_texcoord[model.mesh_texcoordadr[mesh] :][: model.mesh_texcoordnum[mesh], 1]
            (along,) = np.flatnonzero(np.ptp(vertices, axis=0) > 0.1)
            assert (np.ptp(turns) - 1) / np.ptp(vertices[:, along]) == pytest.approx(
                abs(model.actuator_gear[a, 0]) / (2 * np.pi), rel=1e-3
            )


def test_a_machines_digest_does_not_depend_on_its_looks(rigid):
    machine = rigid()
    content = machine.source.read_text()
    looks = """
      <visual><headlight ambient="0.1 0.2 0.3"/><map shadowscale="0.2"/></visual>
      <statistic extent="3" center="1 2 3" meansize="0.2"/>
      <worldbody>
        <camera name="overview" pos="0 0 3"/><light pos="0 0 2"/>
        <geom type="box" size="1 1 1" mass="0" contype="0" conaffinity="0"/>
      </worldbody>
    """
    machine.source.write_text(content.replace("<worldbody>", looks + "<worldbody>", 1))
    drawn = Machine(machine.source)
    assert (drawn.model.ncam, drawn.model.nlight) == (1, 1)
    assert (drawn.physics.ncam, drawn.physics.nlight) == (0, 0)
    assert drawn.digest == machine.digest
    machine.source.write_text(content.replace('mass="3"', 'mass="3.001"'))
    assert Machine(machine.source).digest != machine.digest
    # a sensor that looks through a camera keeps it
    looks = looks.replace("</worldbody>", '<site name="mark"/></worldbody>')
    content = content.replace("<worldbody>", looks + "<worldbody>", 1)
    through = '<sensor><camprojection site="mark" camera="overview"/>'
    machine.source.write_text(
        content.replace("<sensor>", through).replace('pos="0 0 3"', 'pos="0 0 3" resolution="9 9"')
    )
    assert Machine(machine.source).physics.ncam == 1


@pytest.mark.parametrize("name", suite_runs(builtin_models(), 0))
def test_close_up_shadows_are_sharp_and_follow_the_tip(name):
    machine = Machine(name)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    reach = np.minimum(0.25 * (high - low), [0.1 * axis.speed_limit for axis in machine.axes])
    motion = 0.5 * (low + high) + np.linspace(-1, 1, 400)[:, None] * reach
    setpoints = Setpoints(1e-3, machine.axis_names, motion, np.ones(len(motion), bool), ArcChain((0, 0), 0, [0], [10]))
    run = perfect_follower(machine, setpoints)
    for camera in ("overview", "nozzle"):
        with Renderer(machine, run, camera, (160, 120)) as renderer:
            model, data = renderer.model, renderer.data
            light = model.light("key").id
            spread = model.vis.map.shadowscale * model.light_cutoff[light]
            for tick in (0, 399):
                renderer.frame(tick)
                tip = data.site("nozzle").xpos - data.light_xpos[light]
                aside = np.degrees(np.linalg.norm(np.cross(tip, data.light_xdir[light])) / np.linalg.norm(tip))
                if camera == "nozzle":
                    assert aside < 1e-4
                else:
                    assert 0.2 < aside < spread
            wide = machine.model.vis.map.shadowscale * machine.model.light_cutoff[light]
            # 0.11 m round the tip, and then less than 0.2 mm for a pixel of the map
            radius = np.linalg.norm(tip) * np.tan(np.radians(spread))
            assert radius == pytest.approx(0.11, rel=0.1) if camera == "nozzle" else spread == wide
            assert camera != "nozzle" or 2 * radius / model.vis.quality.shadowsize < 2e-4
