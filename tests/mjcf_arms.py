"""Arms as MJCF files have them: kinematics and masses of common arms, without meshes."""

PANDA = """
<mujoco model="panda">
  <compiler angle="radian" meshdir="assets" autolimits="true"/>
  <option integrator="implicitfast"/>
  <default>
    <default class="panda">
      <joint armature="0.1" damping="1" axis="0 0 1" range="-2.8973 2.8973"/>
      <general dyntype="none" biastype="affine" ctrlrange="-2.8973 2.8973" forcerange="-87 87"
        gainprm="4500" biasprm="0 -4500 -450"/>
      <default class="visual">
        <geom type="mesh" contype="0" conaffinity="0" group="2"/>
      </default>
      <default class="finger">
        <joint axis="0 1 0" type="slide" range="0 0.04"/>
      </default>
      <site size="0.001" rgba="0.5 0.5 0.5 0.3" group="4"/>
    </default>
  </default>
  <asset>
    <material name="white" rgba="1 1 1 1" class="panda"/>
    <mesh name="link0_0" file="link0_0.obj"/>
  </asset>
  <worldbody>
    <light name="top" pos="0 0 2" mode="trackcom"/>
    <body name="link0" childclass="panda">
      <inertial mass="0.629769" pos="-0.041018 -0.00014 0.049974"
        fullinertia="0.00315 0.00388 0.004285 8.2904e-7 0.00015 8.2299e-6"/>
      <geom mesh="link0_0" material="white" class="visual"/>
      <body name="link1" pos="0 0 0.333">
        <inertial mass="4.970684" pos="0.003875 0.002081 -0.04762"
          fullinertia="0.70337 0.70661 0.0091170 -0.00013900 0.0067720 0.019169"/>
        <joint name="joint1"/>
        <body name="link2" quat="1 -1 0 0">
          <inertial mass="0.646926" pos="-0.003141 -0.02872 0.003495"
            fullinertia="0.0079620 2.8110e-2 2.5995e-2 -3.925e-3 1.0254e-2 7.04e-4"/>
          <joint name="joint2" range="-1.7628 1.7628"/>
          <body name="link3" pos="0 -0.316 0" quat="1 1 0 0">
            <joint name="joint3"/>
            <inertial mass="3.228604" pos="2.7518e-2 3.9252e-2 -6.6502e-2"
              fullinertia="3.7242e-2 3.6155e-2 1.083e-2 -4.761e-3 -1.1396e-2 -1.2805e-2"/>
            <body name="link4" pos="0.0825 0 0" quat="1 1 0 0">
              <inertial mass="3.587895" pos="-5.317e-2 1.04419e-1 2.7454e-2"
                fullinertia="2.5853e-2 1.9552e-2 2.8323e-2 7.796e-3 -1.332e-3 8.641e-3"/>
              <joint name="joint4" range="-3.0718 -0.0698"/>
              <body name="link5" pos="-0.0825 0.384 0" quat="1 -1 0 0">
                <inertial mass="1.225946" pos="-1.1953e-2 4.1065e-2 -3.8437e-2"
                  fullinertia="3.5549e-2 2.9474e-2 8.627e-3 -2.117e-3 -4.037e-3 2.29e-4"/>
                <joint name="joint5"/>
                <body name="link6" quat="1 1 0 0">
                  <inertial mass="1.666555" pos="6.0149e-2 -1.4117e-2 -1.0517e-2"
                    fullinertia="1.964e-3 4.354e-3 5.433e-3 1.09e-4 -1.158e-3 3.41e-4"/>
                  <joint name="joint6" range="-0.0175 3.7525"/>
                  <body name="link7" pos="0.088 0 0" quat="1 1 0 0">
                    <inertial mass="7.35522e-01" pos="1.0517e-2 -4.252e-3 6.1597e-2"
                      fullinertia="1.2516e-2 1.0027e-2 4.815e-3 -4.28e-4 -1.196e-3 -7.41e-4"/>
                    <joint name="joint7"/>
                    <body name="hand" pos="0 0 0.107" quat="0.9238795 0 0 -0.3826834">
                      <inertial mass="0.73" pos="-0.01 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
                      <site name="attachment_site" pos="0 0 0.1034"/>
                      <body name="left_finger" pos="0 0 0.0584">
                        <inertial mass="0.015" pos="0 0 0" diaginertia="2.375e-6 2.375e-6 7.5e-7"/>
                        <joint name="finger_joint1" class="finger"/>
                      </body>
                      <body name="right_finger" pos="0 0 0.0584" quat="0 0 0 1">
                        <inertial mass="0.015" pos="0 0 0" diaginertia="2.375e-6 2.375e-6 7.5e-7"/>
                        <joint name="finger_joint2" class="finger"/>
                      </body>
                    </body>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="split">
      <joint joint="finger_joint1" coef="0.5"/><joint joint="finger_joint2" coef="0.5"/>
    </fixed>
  </tendon>
  <equality>
    <joint joint1="finger_joint1" joint2="finger_joint2" solimp="0.95 0.99 0.001"/>
  </equality>
  <actuator>
    <general class="panda" name="actuator1" joint="joint1"/>
    <general class="panda" name="actuator2" joint="joint2" ctrlrange="-1.7628 1.7628"/>
    <general class="panda" name="actuator3" joint="joint3"/>
    <general class="panda" name="actuator4" joint="joint4"/>
    <general class="panda" name="actuator5" joint="joint5" forcerange="-12 12"/>
    <general class="panda" name="actuator6" joint="joint6" forcerange="-12 12"/>
    <general class="panda" name="actuator7" joint="joint7" forcerange="-12 12"/>
    <general class="panda" name="actuator8" tendon="split" forcerange="-100 100"
      ctrlrange="0 255" gainprm="0.0157" biasprm="0 -100 -10"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0 0 0 -1.57079 0 1.57079 -0.7853 0.04 0.04"/>
  </keyframe>
</mujoco>
"""

UR5E = """
<mujoco model="ur5e">
  <compiler angle="radian"/>
  <default>
    <default class="ur5e">
      <joint axis="0 1 0" range="-6.28319 6.28319" armature="0.1"/>
      <position ctrlrange="-6.2831 6.2831" kp="2000" kv="400" forcerange="-150 150"/>
      <default class="size1"><position forcerange="-28 28"/></default>
      <geom type="capsule" group="3" mass="0"/>
    </default>
  </default>
  <worldbody>
    <body name="base" quat="0 0 0 -1" childclass="ur5e">
      <inertial mass="4.0" pos="0 0 0" diaginertia="0.00443333156 0.00443333156 0.0072"/>
      <body name="shoulder_link" pos="0 0 0.163">
        <inertial mass="3.7" pos="0 0 0" diaginertia="0.0102675 0.0102675 0.00666"/>
        <joint name="shoulder_pan_joint" axis="0 0 1"/>
        <geom size="0.06 0.06" pos="0 0 -0.04"/>
        <body name="upper_arm_link" pos="0 0.138 0" quat="1 0 1 0">
          <inertial mass="8.393" pos="0 0 0.2125" diaginertia="0.133886 0.133886 0.0151074"/>
          <joint name="shoulder_lift_joint"/>
          <geom size="0.05 0.2" pos="0 0 0.2"/>
          <body name="forearm_link" pos="0 -0.131 0.425">
            <inertial mass="2.275" pos="0 0 0.196" diaginertia="0.0311796 0.0311796 0.004095"/>
            <joint name="elbow_joint" range="-3.1415 3.1415"/>
            <body name="wrist_1_link" pos="0 0 0.392" quat="1 0 1 0">
              <inertial mass="1.219" pos="0 0.127 0" diaginertia="0.0025599 0.0025599 0.0021942"/>
              <joint name="wrist_1_joint"/>
              <body name="wrist_2_link" pos="0 0.127 0">
                <inertial mass="1.219" pos="0 0 0.1" diaginertia="0.0025599 0.0025599 0.0021942"/>
                <joint name="wrist_2_joint" axis="0 0 1"/>
                <body name="wrist_3_link" pos="0 0 0.1">
                  <inertial mass="0.1889" pos="0 0.0771683 0" quat="1 0 0 1"
                    diaginertia="0.000132134 9.90863e-05 9.90863e-05"/>
                  <joint name="wrist_3_joint"/>
                  <site name="attachment_site" pos="0 0.1 0" quat="-1 1 0 0"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="ur5e" name="shoulder_pan" joint="shoulder_pan_joint"/>
    <position class="ur5e" name="shoulder_lift" joint="shoulder_lift_joint"/>
    <position class="ur5e" name="elbow" joint="elbow_joint" ctrlrange="-3.1415 3.1415"/>
    <position class="size1" name="wrist_1" joint="wrist_1_joint"/>
    <position class="size1" name="wrist_2" joint="wrist_2_joint"/>
    <position class="size1" name="wrist_3" joint="wrist_3_joint"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="-1.5708 -1.5708 1.5708 -1.5708 -1.5708 0"/>
  </keyframe>
</mujoco>
"""

IIWA = """
<mujoco model="iiwa14">
  <compiler angle="degree"/>
  <default>
    <joint range="-170 170" damping="0.5" frictionloss="0.2"/>
    <motor ctrlrange="-1 1" gear="100"/>
  </default>
  <worldbody>
    <body name="link1" pos="0 0 0.1575">
      <inertial mass="4" pos="0 -0.03 0.12" diaginertia="0.1 0.09 0.02"/>
      <joint name="joint1"/>
      <body name="link2" pos="0 0 0.2025" euler="90 180 0">
        <inertial mass="4" pos="0.0003 0.059 0.042" diaginertia="0.05 0.018 0.044"/>
        <joint name="joint2" range="-120 120"/>
        <body name="link3" pos="0 0.2045 0" euler="90 0 180">
          <inertial mass="3" pos="0 0.03 0.13" diaginertia="0.08 0.075 0.01"/>
          <joint name="joint3"/>
          <body name="link4" pos="0 0 0.2155" axisangle="1 0 0 90">
            <inertial mass="2.7" pos="0 0.067 0.034" diaginertia="0.03 0.01 0.029"/>
            <joint name="joint4" range="-120 120"/>
            <body name="link5" pos="0 0.1845 0" xyaxes="-1 0 0 0 0 1">
              <inertial mass="1.7" pos="0.0001 0.021 0.076" diaginertia="0.02 0.018 0.005"/>
              <joint name="joint5"/>
              <body name="link6" pos="0 0 0.2155" zaxis="0 -1 0">
                <inertial mass="1.8" pos="0 0.0006 0.0004" diaginertia="0.005 0.0036 0.0047"/>
                <joint name="joint6" range="-120 120"/>
                <body name="link7" pos="0 0.081 0" euler="-90 0 0">
                  <inertial mass="0.3" pos="0 0 0.02" diaginertia="0.001 0.001 0.001"/>
                  <joint name="joint7" range="-175 175"/>
                  <site name="attachment_site" pos="0 0 0.045"/>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="joint1" gear="320"/><motor joint="joint2" gear="-320"/>
    <motor joint="joint3" gear="176"/><motor joint="joint4" gear="176"/>
    <motor joint="joint5" gear="110"/><motor joint="joint6" gear="40"/>
    <motor joint="joint7" gear="40"/>
  </actuator>
</mujoco>
"""

XARM = """
<mujoco model="xarm">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <joint range="-3 3" actuatorfrcrange="-50 50" armature="0.05"/>
    <default class="follower"><joint range="0 0.85" actuatorfrcrange="-9 9"/></default>
    <geom density="1200"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="link1" pos="0 0 0.267">
      <joint name="joint1"/>
      <geom type="cylinder" size="0.05 0.06"/>
      <body name="link2" euler="-1.5708 0 0">
        <joint name="joint2" range="-2.1 2.1"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.05 -0.28 0"/>
        <body name="link3" pos="0.053 -0.2845 0" euler="0 0.1 0">
          <joint name="joint3" range="-3.9 0.2"/>
          <geom type="ellipsoid" size="0.05 0.06 0.1" pos="0.07 0.1 0"/>
          <frame pos="0.0775 0.3425 0" euler="-1.5708 0 0">
            <body name="link4">
              <joint name="joint4"/>
              <geom type="box" size="0.04 0.03 0.08"/>
              <body name="link5" euler="1.5708 0 0">
                <joint name="joint5" range="-1.69 3.14" pos="0.02 0.01 -0.03"/>
                <geom type="sphere" size="0.05"/>
                <body name="link6" pos="0.076 0.097 0" euler="-1.5708 0 0">
                  <joint name="joint6"/>
                  <geom type="cylinder" size="0.035 0.02"/>
                  <body name="gripper_base" pos="0 0 0.05">
                    <geom type="box" size="0.03 0.05 0.03"/>
                    <site name="link_tcp" pos="0 0 0.172"/>
                    <body name="left_outer" pos="0 0.035 0.059">
                      <joint name="drive_joint" range="0 0.85" axis="1 0 0"/>
                      <geom type="box" size="0.01 0.01 0.03" pos="0 0.03 0.03"/>
                      <body name="left_finger" pos="0 0.0356 0.0424">
                        <joint name="left_finger_joint" axis="-1 0 0" class="follower"/>
                        <geom type="box" size="0.01 0.005 0.03"/>
                      </body>
                    </body>
                    <body name="right_outer" pos="0 -0.035 0.059">
                      <joint name="right_driver" axis="-1 0 0" class="follower"/>
                      <geom type="box" size="0.01 0.01 0.03" pos="0 -0.03 0.03"/>
                    </body>
                  </body>
                </body>
              </body>
            </body>
          </frame>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="left_finger_joint" joint2="drive_joint"/>
    <joint joint1="right_driver" joint2="drive_joint" polycoef="0.01 0.98 0 0 0"/>
  </equality>
</mujoco>
"""

# Bodies with several joints, anchors away from the frame, ref of a slide and of a hinge.
GANTRY = """
<mujoco model="gantry">
  <option gravity="0.3 -0.2 -3.71"/>
  <compiler angle="degree"/>
  <worldbody>
    <body name="carriage" pos="0.1 0 1" euler="0 10 20">
      <joint name="x" type="slide" axis="1 0 0" range="-0.5 1.5" ref="0.2"/>
      <joint name="y" type="slide" axis="0 1 0.2" range="-1 1"/>
      <joint name="yaw" axis="0 0 1" pos="0.1 0.05 0" range="-90 170" ref="40"/>
      <geom type="box" size="0.2 0.1 0.1" mass="6"/>
      <body name="wrist" pos="0.3 0 -0.2" quat="0.9 0.1 -0.2 0.3">
        <joint name="pitch" axis="0 1 0" pos="0 0.02 0.01" range="-100 100" ref="-15"/>
        <joint name="roll" axis="1 0.1 0" range="-100 100"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1.5"/>
        <body name="lift" pos="0.3 0 0">
          <joint name="reach" type="slide" axis="1 0 0" ref="-0.1" range="-0.1 0.3"/>
          <joint name="spin" axis="1 0 0"/>
          <geom type="sphere" size="0.05" mass="0.7"/>
          <site name="tool" pos="0.05 0.02 0" euler="0 90 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" gear="300" ctrlrange="-1 1"/>
    <position joint="yaw" kp="100" forcerange="-60 80"/>
    <motor joint="pitch" gear="-2" ctrlrange="-10 10" name="a"/>
    <motor joint="pitch" gear="3" ctrlrange="-5 5" forcerange="-4 4" name="b"/>
    <velocity joint="roll" kv="3"/>
    <motor joint="spin"/>
  </actuator>
</mujoco>
"""

# A base that floats, with a follower between the joints of the arm.
MOBILE = """
<mujoco model="mobile">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base" pos="0.4 -0.2 0.5" quat="0.98 0 0 0.2">
      <freejoint name="floating_base"/>
      <geom type="box" size="0.3 0.2 0.1" mass="40"/>
      <body name="wheel" pos="0.2 0.2 0">
        <joint name="wheel_joint" axis="0 1 0"/>
        <geom type="cylinder" size="0.1 0.02" mass="2"/>
      </body>
      <body name="mast" pos="0 0 0.1">
        <joint name="lift" type="slide" axis="0 0 1" range="0 0.5"/>
        <geom type="box" size="0.05 0.05 0.2" mass="3"/>
        <body name="upper" pos="0.05 0 0.3">
          <joint name="shoulder" axis="0 1 0" range="-2 2" ref="0.3" pos="0 0 0.01"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04" mass="2"/>
          <body name="middle" pos="0.3 0 0">
            <joint name="coupled" axis="0 1 0" range="-4 4" ref="0.1"/>
            <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.03" mass="0.5"/>
            <body name="fore" pos="0.1 0 0">
              <joint name="elbow" axis="0 0 1" range="-2 2"/>
              <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.03" mass="1"/>
              <site name="grip_site" pos="0.28 0 0"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="coupled" joint2="shoulder" polycoef="0.05 -2 0 0 0"/></equality>
</mujoco>
"""

ARMS = {
    "panda": PANDA,
    "ur5e": UR5E,
    "iiwa14": IIWA,
    "xarm": XARM,
    "gantry": GANTRY,
    "mobile": MOBILE,
}
