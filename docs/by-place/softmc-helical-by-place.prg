Circle G1 Angle=180 CircleCenter={ 0.0, 0,  5,  180}
Circle G1 Angle=180 CircleCenter={12.5, 0, 10,  360} Vtran=353
Circle G1 Angle=180 CircleCenter={ 0.0, 0, 15,  540} Vtran=360
Circle G1 Angle=180 CircleCenter={12.5, 0, 20,  720} Vtran=360
Circle G1 Angle=180 CircleCenter={ 0.0, 0, 25,  900} Vtran=360
Circle G1 Angle=180 CircleCenter={12.5, 0, 30, 1080} Vtran=360
Circle G1 Angle=180 CircleCenter={ 0.0, 0, 35, 1260} Vtran=360
Circle G1 Angle=180 CircleCenter={12.5, 0, 40, 1440} Vtran=360
