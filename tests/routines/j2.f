C     Linear elasticity and von Mises' plasticity with linear isotropic
C     hardening.  PROPS: E, nu, yield stress, hardening modulus.
C     STATEV: accumulated plastic strain.  A shorter step is asked for
C     where that grows by more than 1.
      SUBROUTINE UMAT(STRESS,STATEV,DDSDDE,SSE,SPD,SCD,RPL,DDSDDT,
     1 DRPLDE,DRPLDT,STRAN,DSTRAN,TIME,DTIME,TEMP,DTEMP,PREDEF,DPRED,
     2 CMNAME,NDI,NSHR,NTENS,NSTATV,PROPS,NPROPS,COORDS,DROT,PNEWDT,
     3 CELENT,DFGRD0,DFGRD1,NOEL,NPT,LAYER,KSPT,KSTEP,KINC)
      IMPLICIT REAL*8(A-H,O-Z)
      CHARACTER*80 CMNAME
      DIMENSION STRESS(NTENS),STATEV(NSTATV),DDSDDE(NTENS,NTENS),
     1 STRAN(NTENS),DSTRAN(NTENS),PROPS(NPROPS),FLOW(6)
      G = PROPS(1)/2.D0/(1.D0+PROPS(2))
      BULK = PROPS(1)/3.D0/(1.D0-2.D0*PROPS(2))
      DO I=1,NTENS
        DO J=1,NTENS
          DDSDDE(I,J)=0.D0
        END DO
      END DO
      DO I=1,3
        DO J=1,3
          DDSDDE(I,J)=BULK-2.D0*G/3.D0
        END DO
        DDSDDE(I,I)=BULK+4.D0*G/3.D0
        DDSDDE(I+3,I+3)=G
      END DO
      DO I=1,NTENS
        DO J=1,NTENS
          STRESS(I)=STRESS(I)+DDSDDE(I,J)*DSTRAN(J)
        END DO
      END DO
      P=(STRESS(1)+STRESS(2)+STRESS(3))/3.D0
      Q=0.D0
      DO I=1,3
        FLOW(I)=STRESS(I)-P
        FLOW(I+3)=STRESS(I+3)
        Q=Q+1.5D0*FLOW(I)**2+3.D0*FLOW(I+3)**2
      END DO
      Q=SQRT(Q)
      YIELD=PROPS(3)+PROPS(4)*STATEV(1)
      IF (Q.GT.YIELD) THEN
        DP=(Q-YIELD)/(3.D0*G+PROPS(4))
        STATEV(1)=STATEV(1)+DP
        IF (DP.GT.1.D0) PNEWDT=0.5D0
        FACTOR=1.D0-3.D0*G*DP/Q
        DO I=1,3
          STRESS(I)=P+FACTOR*FLOW(I)
          STRESS(I+3)=FACTOR*FLOW(I+3)
        END DO
        A=2.D0*G*FACTOR
        B=9.D0*G*G/Q/Q*(DP/Q-1.D0/(3.D0*G+PROPS(4)))
        DO I=1,3
          DO J=1,3
            DDSDDE(I,J)=BULK-A/3.D0
          END DO
        END DO
        DO I=1,3
          DDSDDE(I,I)=BULK+2.D0*A/3.D0
          DDSDDE(I+3,I+3)=A/2.D0
        END DO
        DO I=1,6
          DO J=1,6
            DDSDDE(I,J)=DDSDDE(I,J)+B*FLOW(I)*FLOW(J)
          END DO
        END DO
      END IF
      RETURN
      END
