"""Small machines whose motors share coordinates: two belts (CoreXY), and a bridge with a motor on either side."""

from gantrysim import Machine

_HEAD = """
<mujoco>
  <size nuser_jnt="1" nuser_sensor="1"/>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.00025" integrator="Euler" gravity="0 0 0"><flag contact="disable"/></option>
  <custom><text name="kinematics" data="coupled"/></custom>
  <default>
    <joint type="slide" range="-0.3 0.3"/>
    <dcmotor input="ff" controller="0 0 0 0 0 24" motorconst="0.03 0.03" resistance="0.3" inductance="1e-4"
      saturation="0 30 0" ctrlrange="-0.9 0.9"/>
  </default>
"""

# Pulleys of 10 mm radius whose hinges a and b pull two belts: 0.01 a = x + y, 0.01 b = x - y.
COREXY = (
    _HEAD
    + """
  <worldbody>
    <body name="work" pos="0.1 0.2 0.3" euler="0 0 0.4">
      <body name="pulley_a" pos="-0.3 -0.3 0">
        <joint name="a" type="hinge" axis="0 0 1" range="-100 100" user="200" damping="1e-3"/>
        <geom size="0.01" mass="0.05"/>
      </body>
      <body name="pulley_b" pos="0.3 -0.3 0">
        <joint name="b" type="hinge" axis="0 0 1" range="-100 100" user="200" damping="1e-3"/>
        <geom size="0.01" mass="0.05"/>
      </body>
      <body name="bridge">
        <joint name="y" axis="0 1 0" range="-0.15 0.15" damping="5"/>
        <geom size="0.02" mass="1.5"/>
        <body name="carriage">
          <joint name="x" axis="1 0 0" range="-0.15 0.15" damping="5"/>
          <geom size="0.02" mass="0.8"/>
          <site name="nozzle"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="belt_a" stiffness="4e5" damping="80" springlength="0">
      <joint joint="a" coef="0.01"/><joint joint="x" coef="-1"/><joint joint="y" coef="-1"/>
    </fixed>
    <fixed name="belt_b" stiffness="4e5" damping="80" springlength="0">
      <joint joint="b" coef="0.01"/><joint joint="x" coef="-1"/><joint joint="y" coef="1"/>
    </fixed>
  </tendon>
  <actuator>
    <dcmotor name="a" joint="a" gear="1" armature="1e-4"/>
    <dcmotor name="b" joint="b" gear="1" armature="1e-4"/>
  </actuator>
  <sensor>
    <actuatorpos name="a" actuator="a" user="100000"/>
    <actuatorpos name="b" actuator="b" user="100000"/>
  </sensor>
</mujoco>
"""
)

# Two nuts 400 mm apart that carry a bridge through stiff mounts; it can skew by its hinge.
TANDEM = (
    _HEAD
    + """
  <worldbody>
    <body name="work"/>
    <body name="nut1" pos="-0.2 0 0">
      <joint name="y1" axis="0 1 0" user="1" damping="8"/>
      <geom size="0.01" mass="0.2"/>
    </body>
    <body name="nut2" pos="0.2 0 0">
      <joint name="y2" axis="0 1 0" user="1" damping="8"/>
      <geom size="0.01" mass="0.2"/>
    </body>
    <body name="bridge">
      <joint name="y" axis="0 1 0" damping="5"/>
      <joint name="skew" type="hinge" axis="0 0 1" range="-0.01 0.01" stiffness="2e4" damping="20"/>
      <geom type="box" size="0.25 0.02 0.02" mass="4"/>
      <body name="carriage">
        <joint name="x" axis="1 0 0" range="-0.15 0.15" user="1" damping="8"/>
        <geom size="0.02" mass="1.5"/>
        <site name="nozzle"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="mount1" stiffness="1e7" damping="600" springlength="0">
      <joint joint="y1" coef="1"/><joint joint="y" coef="-1"/><joint joint="skew" coef="0.2"/>
    </fixed>
    <fixed name="mount2" stiffness="1e7" damping="600" springlength="0">
      <joint joint="y2" coef="1"/><joint joint="y" coef="-1"/><joint joint="skew" coef="-0.2"/>
    </fixed>
  </tendon>
  <actuator>
    <dcmotor name="x" joint="x" gear="628.3185307179586" armature="2.5e-5"/>
    <dcmotor name="y1" joint="y1" gear="628.3185307179586" armature="2.5e-5"/>
    <dcmotor name="y2" joint="y2" gear="628.3185307179586" armature="2.5e-5"/>
  </actuator>
  <sensor>
    <actuatorpos name="x" actuator="x" user="10000"/>
    <actuatorpos name="y1" actuator="y1" user="10000"/>
    <actuatorpos name="y2" actuator="y2" user="10000"/>
  </sensor>
</mujoco>
"""
)


def corexy(folder):
    file = folder / "corexy.xml"
    file.write_text(COREXY)
    return Machine(file)


def tandem(folder):
    file = folder / "tandem.xml"
    file.write_text(TANDEM)
    return Machine(file)
